"""The folder a run leaves: `runs/<time>-<name>/` with settings, recordings, summary, report and plots."""

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.texts import shown
from cogrip.protocol.wire.accounts import ClientAccount

_MOST_LOG, _MOST_TOLD = 1_000_000, 20  # most characters and lines of a log that are read: anybody may have written it
SUMMARY = "summary.json"
SETTINGS = "settings.json"
SERVER_RECORDING = "server.mcap"
WARNINGS = "warnings.log"
CLOCKS = "clocks.json"  # file of a run that was merged from several machines


def client_recording(name: str) -> str:
    """File name of one person's recording."""
    return f"client-{_file_name(name)}.mcap"


def client_log(name: str) -> str:
    """File name of the log of one person's client."""
    return f"client-{_file_name(name)}.log"


def write_warnings(folder: Path, lines: Sequence[str], name: str = "") -> None:
    """Leave what was warned of in a run's folder, for its report. name: of the person whose client warned"""
    if lines:
        (folder / (client_log(name) if name else WARNINGS)).write_text("".join(f"{line}\n" for line in lines), "utf-8")


def told_in_log(log: Path) -> list[str]:
    """Return what a client's log warns of, and counts, a line each, without control characters; none where there is no log."""
    try:
        with log.open(encoding="utf-8", errors="replace") as file:
            lines = file.read(_MOST_LOG).splitlines()
    except OSError:
        return []
    told = [line for line in lines if ": dealt with: " in line or line.startswith("warning: ")]
    return [shown(line) for line in told[:_MOST_TOLD]]


def _file_name(name: str) -> str:
    """A name as part of a file name; `+` is in no name, so no two names become one."""
    return name.replace(" ", "+")


def make_run_folder(base: Path, name: str, now: datetime) -> Path:
    """Make a new folder below `base`, never one that exists."""
    stem = f"{now:%Y%m%d-%H%M%S}-{_file_name(name)}"
    for suffix in ("", *(f"-{number}" for number in range(2, 1000))):
        folder = base / f"{stem}{suffix}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        return folder
    raise FileExistsError(f"{base / stem}: a thousand runs of that name in one second; give another --runs folder")


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: a full disk leaves no empty one that looks like a result. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)  # it may have been removed while the session ran
    new = path.with_name(f"{path.name}.new")
    try:
        new.write_bytes(content)
        new.replace(path)
    except OSError as error:
        with suppress(OSError):
            new.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from None


def write_settings(folder: Path, settings: Settings) -> None:
    write_whole(folder / SETTINGS, msgspec.json.format(msgspec.json.encode(settings), indent=2) + b"\n")


def write_account(folder: Path, name: str, account: ClientAccount) -> None:
    """Write what one client knows, for `read_accounts`."""
    write_whole((folder / client_recording(name)).with_suffix(".json"), msgspec.json.encode(account))


def read_accounts(folder: Path, names: Sequence[str]) -> dict[str, ClientAccount | None]:
    """Return what the clients of these names left by `write_account`; None for one that left nothing."""
    found: dict[str, ClientAccount | None] = {}
    for name in names:
        path = (folder / client_recording(name)).with_suffix(".json")
        try:
            found[name] = msgspec.json.decode(path.read_bytes(), type=ClientAccount)
        except (OSError, msgspec.MsgspecError):
            found[name] = None
    return found


def summary_text(summary: dict[str, Any]) -> str:
    """Return the summary as JSON text: null for what is not finite, sorted as written, one trailing newline."""
    return json.dumps(finite(summary), indent=1, allow_nan=False) + "\n"


def finite(value: Any) -> Any:
    """Return a value with None for floats that are not finite, which JSON does not have."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return value


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    write_whole(folder / SUMMARY, summary_text(summary).encode())
