"""Pages of reference hold every name of what they describe: commands, settings, keys of `summary.json`."""

import re

import msgspec

from cogrip.cli.main import COMMANDS
from cogrip.protocol.settings import Settings, resolve
from cogrip.sim.runs.laboratory_run import run_laboratory

from tests.docs.pages import page


def named(text: str) -> set[str]:
    """Return every dotted part of what stands between backticks."""
    return {part for found in re.findall(r"`([^`]+)`", text) for part in re.split(r"[^\w*]+", found)}


def field_names(kind: type[msgspec.Struct]) -> set[str]:
    """Return the names of a struct's fields and of all structs in them."""
    names: set[str] = set()
    for field in msgspec.structs.fields(kind):
        names.add(field.encode_name)
        for part in (field.type, *getattr(field.type, "__args__", ())):
            if isinstance(part, type) and issubclass(part, msgspec.Struct):
                names |= field_names(part)
    return names


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
