"""Pages of reference hold every name of what they describe: commands, settings, keys of `summary.json`."""

import re
from typing import Any, get_args, get_origin, get_type_hints

import msgspec

from cogrip.cli.main import COMMANDS
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.docs.pages import page


def named(text: str) -> set[str]:
    """Return every dotted part of what stands between backticks."""
    return {part for found in re.findall(r"`([^`]+)`", text) for part in re.split(r"[^\w*]+", found)}


def field_names(kind: Any) -> set[str]:
    """Return the names of the fields of all structs in a type."""
    parts: set[str] = set()
    for part in (get_origin(kind), *get_args(kind)):
        parts |= field_names(part) if part is not None else set()
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        hints = get_type_hints(kind, include_extras=True)
        for field in msgspec.structs.fields(kind):
            parts |= {field.encode_name} | field_names(hints[field.name])
    return parts


def test_every_command_is_on_its_page() -> None:
    text = page("docs/commands.md") + page("docs/recordings.md")
    assert [name for name in COMMANDS if f"cogrip {name}" not in text] == []


def test_every_setting_is_on_its_page() -> None:
    sections = {"rates", "coupling", "object", "link", "playout", "admission", "users"}
    assert sorted(field_names(Settings) - named(page("docs/settings.md")) - sections) == []


def test_every_key_of_a_summary_is_on_its_page(tmp_path) -> None:
    run_laboratory(resolve({"seconds": 0.1}), tmp_path)
    summary = msgspec.json.decode((tmp_path / "summary.json").read_bytes())
    keys = set(summary) | set(summary["users"][0]) | set(summary["users"][0]["energy"])
    assert sorted(keys - named(page("docs/summary.md")) - {"users", "energy", "name", "seed", "seconds"}) == []
