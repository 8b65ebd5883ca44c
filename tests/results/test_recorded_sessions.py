"""Sessions recorded by an earlier version play again bit for bit. Meant to change: `python3 dev.py rerecord`."""

import json
import platform
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from cogrip.protocol.recording.derived import DERIVED
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.recording.records import kind_of
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS
from cogrip.protocol.settings.room import resolve
from cogrip.results.replay.comparison import ReplayComparison
from cogrip.results.replay.verify import verify
from cogrip.results.writing.laboratory_run import run_laboratory

RECORDINGS = Path(__file__).resolve().parents[1] / "recordings"
FILES = sorted(RECORDINGS.glob("*/*.mcap"))


def test_a_session_of_every_scheme_is_here():
    kinds = {json.loads((folder / "settings.json").read_text())["coupling"]["kind"] for folder in RECORDINGS.glob("*/")}
    assert kinds == set(COUPLING_KINDS)
    assert len(FILES) == 3 * (2 + len(COUPLING_KINDS) - 1)
    assert sum(path.stat().st_size for path in FILES) < 2_000_000


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_it_plays_again_bit_by_bit(path):
    recording = open_recording(path)
    if recording.header.versions.machine != platform.machine():
        pytest.skip(f"recorded on {recording.header.versions.machine}, this is {platform.machine()}")
    found = verify(recording)
    assert found.exact, found
    assert not found.cut
    rate_hz = recording.header.rate_hz
    assert found.ticks > 0.7 * rate_hz


def test_the_laboratory_still_comes_to_the_same_numbers(tmp_path):
    """The settings are run, not the record: devices, hands and links are the same as well."""
    table = json.loads((RECORDINGS / "laboratory" / "settings.json").read_text())
    run_laboratory(resolve(table), tmp_path)
    for name in ("client-anna.mcap", "client-ben.mcap", "server.mcap"):
        old, new = open_recording(RECORDINGS / "laboratory" / name), open_recording(tmp_path / name)
        comparison = ReplayComparison(old.topics)
        for message in old.messages():
            if kind_of(old.topics[message.topic]) not in DERIVED:
                comparison.expect(message)
        for message in new.messages():
            if kind_of(new.topics[message.topic]) not in DERIVED:
                comparison.put(*message)
        comparison.finish()
        assert comparison.difference is None, name


def test_each_message_of_a_session_validates_against_the_schema_beside_it(tmp_path):
    """The reader and the validator are other projects'; each message holds every key of its schema."""
    jsonschema = pytest.importorskip("jsonschema")
    plain = jsonschema.Draft202012Validator

    def nullable(validator: Any, types: Any, value: Any, schema: dict[str, Any]) -> Any:
        """`type`, but null is right where the schema has `nullable`, as in OpenAPI 3.0."""
        if value is not None or not schema.get("nullable"):
            yield from plain.VALIDATORS["type"](validator, types, value, schema)

    make = jsonschema.validators.extend(plain, {"type": nullable})
    users = [{"name": "anna"}, {"name": "ben", "device": "sim:ideal", "hand": "hold"}]
    run_laboratory(resolve({"seconds": 0.1, "users": users}), tmp_path)
    kinds = set()
    for path in tmp_path.glob("*.mcap"):
        with path.open("rb") as file:
            validators: dict[int, Any] = {}
            for schema, channel, message in make_reader(file).iter_messages():
                if schema.id not in validators:
                    table = json.loads(schema.data)
                    plain.check_schema(table)
                    validators[schema.id] = make(table)
                value = json.loads(message.data)
                validators[schema.id].validate(value)
                assert set(value) - {"unfit"} == set(validators[schema.id].schema["properties"])
                kinds.add(channel.topic.rpartition("/")[2])
    assert {"tick", "step", "datagram_in", "datagram_out", "input", "answer", "event", "account"} <= kinds
