"""Verification of whole runs: bit for bit for every shipped session over bad links, and nothing altered goes unnoticed."""

import json
import shutil
from collections.abc import Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cogrip.cli.main import main
from cogrip.cli.session.settings_file import load
from cogrip.protocol import messages
from cogrip.protocol.coupling_kinds import COUPLING_KINDS
from cogrip.protocol.messages import Waves
from cogrip.protocol.recording.header import Header
from cogrip.protocol.recording.reader import Damage, Message, Recording, RecordingError, open_recording
from cogrip.protocol.recording.records import KINDS, Datagram, Tick, kind_of
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.settings import Settings, rates_of, resolve
from cogrip.sim.runs.folder import client_recording
from cogrip.sim.runs.laboratory_run import run_laboratory
from cogrip.sim.runs.replay.verify import Verdict, verify

from tests.extent import every
from tests.recording_files import rewrite, written

CONFIGS = sorted((Path(__file__).resolve().parents[2] / "configs").glob("*.toml"))
# compare.toml is so stiff that the step of the paper leaves the room before the end, as meant; effects.toml needs three axes
FEW = [
    config
    for config in CONFIGS
    if len(load(config).users) <= 3
    and config.stem not in ("compare", "effects")
    and load(config).object.kind != "scene"
]
BAD_LINK = (
    "link.jitter_ms=6", "link.loss=0.1", "link.burst_frames=3", "link.duplicate=0.1", "link.reorder=0.1",
)  # fmt: skip
COUPLINGS: dict[str, tuple[str, ...]] = {
    "as shipped": (),
    "boxcar": ("coupling.decimator=boxcar", "coupling.encoder=displacement", "coupling.server_step=passive"),
    "low-pass": ("coupling.decimator=lowpass", "coupling.encoder=velocity", "coupling.server_step=passive"),
    "samples": ("coupling.decimator=none", "coupling.encoder=displacement", "coupling.server_step=passive"),
    "the paper's step": ("coupling.decimator=none", "coupling.encoder=velocity", "coupling.server_step=paper"),
    **{
        kind: (f"coupling.kind={kind}", "coupling.server_step=passive")
        for kind, traits in COUPLING_KINDS.items()
        if not traits.waves
    },
}


def verdicts_of(world: Settings, folder: Path) -> dict[str, Verdict]:
    """Run it in the laboratory, and verify what is left."""
    folder.mkdir(exist_ok=True)
    run_laboratory(world, folder)
    return {path.name: verify(open_recording(path)) for path in folder.glob("*.mcap")}


def is_exact(world: Settings, verdicts: dict[str, Verdict]) -> None:
    assert len(verdicts) == 1 + len(world.users)
    for file, verdict in verdicts.items():
        assert verdict.exact, (file, verdict.difference, verdict.hole)
        assert not verdict.cut
        assert verdict.versions == ()
        frames = round(world.seconds * world.rates.network_hz)
        ticks_per_frame = {client_recording(user.name): rates_of(world, user).ticks_per_frame for user in world.users}
        assert verdict.ticks == frames * ticks_per_frame.get(file, 1), "to the end"
        assert verdict.messages > verdict.ticks


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("config", "axes", "coupling"),
    every(17, product(FEW, (1, 3), COUPLINGS)),
    ids=lambda value: getattr(value, "stem", value),
)
def test_every_shipped_session_over_a_bad_link_is_exact(config: Path, axes: int, coupling: str, tmp_path: Path) -> None:
    one_axis = ("users.0.hand=reach", "users.1.hand=reach") if axes == 1 and config.stem == "three-users" else ()
    world = load(config, ("seconds=0.3", f"object.axes={axes}", *BAD_LINK, *COUPLINGS[coupling], *one_axis))
    is_exact(world, verdicts_of(world, tmp_path))


@pytest.mark.sample(2)
@pytest.mark.parametrize("config", every(4, CONFIGS), ids=lambda path: path.stem)
def test_every_shipped_session_is_exact_for_longer(config: Path, tmp_path: Path) -> None:
    world = load(config, ("seconds=1.0",) if config in FEW else ("seconds=0.3", *BAD_LINK))
    is_exact(world, verdicts_of(world, tmp_path))


@settings(max_examples=12)
@given(
    st.sampled_from(["cube", "faces", "wall"]), st.integers(1, 3), st.floats(0.0, 60.0), st.floats(0.0, 20.0),
    st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.integers(0, 6), st.integers(0, 2**53),
)  # fmt: skip
def test_any_session_is_exact(
    tmp_path_factory: pytest.TempPathFactory, kind: str, axes: int, delay_ms: float, jitter_ms: float, loss: float,
    duplicate: float, reorder: float, playout: int, seed: int,
) -> None:  # fmt: skip
    people = [{"name": "anna", "side": "left", "hand": "reach"}, {"name": "ben", "side": "right", "hand": "tremor"}]
    world = resolve({
        "seed": seed, "seconds": 0.15, "object": {"kind": kind, "axes": axes}, "playout": {"frames": playout},
        "link": {"delay_ms": delay_ms, "jitter_ms": jitter_ms, "loss": loss, "duplicate": duplicate, "reorder": reorder},
        "users": people[:1] if kind == "wall" else people,
    })  # fmt: skip
    is_exact(world, verdicts_of(world, tmp_path_factory.mktemp("run")))


def test_a_session_that_diverges_is_exact(tmp_path: Path) -> None:
    """Numbers beyond all bounds are recorded, too."""
    stiff = (
        "coupling.stiffness_npm=1e5", "coupling.server_step=paper", "link.delay_ms=31.25", "playout.frames=0", "seconds=4",
        "users.0.device=sim:ideal", "users.1.device=sim:ideal",
    )  # fmt: skip
    verdicts = verdicts_of(load(CONFIGS[0], stiff), tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["diverged"]
    assert [verdict.exact for verdict in verdicts.values()] == [True] * 3


def test_one_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    world = load(CONFIGS[0], ("seconds=0.2", *BAD_LINK))
    for name in "ab":
        verdicts_of(world, tmp_path / name)
    for path in (tmp_path / "a").glob("*.mcap"):
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


class Recorded:
    """A recording in memory, to be spoilt and written again."""

    def __init__(self, path: Path) -> None:
        recording = open_recording(path)
        self.path, self.header = path, recording.header
        self.messages = list(recording.messages())
        self.kinds = [kind_of(recording.topics[message.topic]) for message in self.messages]

    def of(self, *kinds: str) -> list[int]:
        """Return the places of messages of these kinds."""
        return [at for at, kind in enumerate(self.kinds) if kind in kinds]

    def news(self) -> list[tuple[int, Datagram, Waves]]:
        """Return the datagrams that brought the newest frame of all before the next tick or step; no other one does in time."""
        newest: dict[Any, int] = {}
        waiting: dict[Any, tuple[int, Datagram, Waves]] = {}
        found: list[tuple[int, Datagram, Waves]] = []
        for at, kind in enumerate(self.kinds):
            if kind in ("tick", "step"):
                found += waiting.values()
                waiting.clear()
            elif kind == "datagram_in":
                heard = msgspec.json.decode(self.messages[at].payload, type=Datagram)
                said = messages.decode(heard.data)
                if isinstance(said, Waves) and newest.get(heard.address, 0) < (end := said.stamp.sent_ns):
                    newest[heard.address] = end
                    waiting[heard.address] = (at, heard, said)
        return found

    def written(self, changed: Sequence[Message], header: Header | None = None) -> Recording:
        path = self.path.with_name("changed.mcap")
        with written(path, header or self.header) as writer:
            for message in changed:
                writer.put(*message)
        return open_recording(path)

    def altered(self, at: int, payload: bytes) -> Verdict:
        changed = [*self.messages[:at], self.messages[at]._replace(payload=payload), *self.messages[at + 1 :]]
        return verify(self.written(changed))


WORLD: dict[str, Any] = {
    "seconds": 0.25, "object": {"axes": 2}, "playout": {"frames": 1},
    "link": {"delay_ms": 8, "jitter_ms": 4, "loss": 0.05, "duplicate": 0.05, "reorder": 0.05},
    "users": [{"name": "anna", "hand": "reach"}, {"name": "ben", "hand": "tremor"}],
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short session of two over a bad link."""
    folder = tmp_path_factory.mktemp("run")
    is_exact(resolve(WORLD), verdicts_of(resolve(WORLD), folder))
    return folder


@pytest.fixture(scope="module")
def anna(folder: Path) -> Recorded:
    return Recorded(folder / "client-anna.mcap")


@pytest.fixture(scope="module", params=["client-anna.mcap", "server.mcap"])
def recorded(request: pytest.FixtureRequest, folder: Path) -> Recorded:
    """Either end of it."""
    return Recorded(folder / request.param)


@given(st.data())
def test_one_digit_of_a_force_is_found(anna: Recorded, data: st.DataObject) -> None:
    at = data.draw(st.sampled_from(anna.of("tick")[30:]))
    payload = anna.messages[at].payload
    start = payload.index(b'"force_n":[') + len(b'"force_n":[')
    text = payload[start : payload.index(b",", start)]
    digits = [place for place, sign in enumerate(text.partition(b"e")[0]) if 48 < sign < 58]  # not a 0 that may lead
    assume(digits)
    place = data.draw(st.sampled_from(digits))
    other = text[:place] + bytes([text[place] % 9 + 49 if text[place] < 57 else 49]) + text[place + 1 :]
    verdict = anna.altered(at, payload[:start] + other + payload[start + len(text) :])
    found = verdict.difference
    assert (found.time_ns, found.topic, found.field) == (anna.messages[at].time_ns, "/anna/tick", "force_n[0]")
    assert (float(found.recorded), float(found.replayed)) == (float(other), float(text))
    assert verdict.messages == at
    assert not verdict.exact


def as_before(kind: str, message: Message) -> bytes:
    """Return a message as an earlier cogrip wrote it: fields at their defaults left out."""
    table = json.loads(message.payload)
    defaults = {field.name: field.default for field in msgspec.structs.fields(KINDS[kind])}
    return msgspec.json.encode({key: value for key, value in table.items() if value != defaults[key]})


def test_files_that_leave_out_defaults_play_again_and_what_differs_in_them_is_found(
    folder: Path, tmp_path: Path
) -> None:
    for name in ("client-anna.mcap", "server.mcap"):
        shutil.copy(folder / name, tmp_path)
        rewrite(tmp_path / name, as_before)
        assert verify(open_recording(tmp_path / name)).exact, name

    def one_lost(kind: str, message: Message) -> bytes:
        table = json.loads(as_before(kind, message))
        return msgspec.json.encode(table | ({"lost": 77} if table.get("tick") == 100 else {}))

    rewrite(tmp_path / "client-anna.mcap", one_lost)
    found = verify(open_recording(tmp_path / "client-anna.mcap")).difference
    assert (found.topic, found.field, found.recorded) == ("/anna/tick", "lost", "77")


@given(data=st.data())
def test_one_byte_of_a_datagram_that_was_sent_is_found(recorded: Recorded, data: st.DataObject) -> None:
    at = data.draw(st.sampled_from(recorded.of("datagram_out")))
    message = recorded.messages[at]
    sent = msgspec.json.decode(message.payload, type=Datagram)
    bytes_ = bytearray(sent.data)
    bytes_[data.draw(st.integers(0, len(bytes_) - 1))] ^= data.draw(st.integers(1, 255))
    found = recorded.altered(at, encode(Datagram(bytes(bytes_), sent.address))).difference
    assert (found.time_ns, found.topic, found.field) == (
        message.time_ns,
        f"/{recorded.header.who}/datagram_out",
        "data",
    )
    assert json.loads(found.replayed) == json.loads(message.payload)["data"]
    assert found.recorded != found.replayed


@given(data=st.data())
def test_the_seventh_digit_of_a_wave_that_was_heard_is_found(recorded: Recorded, data: st.DataObject) -> None:
    """The wave is of the newest frame in the datagram that brings it first: later ones repeat it."""
    moving = [each for each in recorded.news()[:-8] if max(map(abs, each[2].waves)) > 1e-3]  # the last are never played
    at, heard, said = data.draw(st.sampled_from(moving))
    axes = len(said.state) // 2
    place = max(range(len(said.waves) - axes, len(said.waves)), key=lambda each: abs(said.waves[each]))
    waves = list(said.waves)
    waves[place] *= 1.0 + 1e-6
    other = messages.encode(msgspec.structs.replace(said, waves=tuple(waves)))
    found = recorded.altered(at, encode(Datagram(other, heard.address))).difference
    assert 0 <= found.time_ns - recorded.messages[at].time_ns < 100_000_000, "once it is played"
    assert found.topic in ("/anna/tick", "/anna/datagram_out", "/server/datagram_out", "/room/session/step")
    assert found.recorded != found.replayed


@given(data=st.data())
def test_any_byte_that_was_heard_is_harmless_or_found_afterwards(recorded: Recorded, data: st.DataObject) -> None:
    at = data.draw(st.sampled_from(recorded.of("datagram_in")[1:]))  # without the first there is no seat
    heard = msgspec.json.decode(recorded.messages[at].payload, type=Datagram)
    bytes_ = bytearray(heard.data)
    bytes_[data.draw(st.integers(0, len(bytes_) - 1))] ^= data.draw(st.integers(1, 255))
    found = recorded.altered(at, encode(Datagram(bytes(bytes_), heard.address))).difference
    if found is not None:
        assert found.time_ns >= recorded.messages[at].time_ns
        assert found.recorded != found.replayed


@given(data=st.data())
def test_one_message_that_is_missing_is_found(recorded: Recorded, data: st.DataObject) -> None:
    places = [recorded.of(kind) for kind in ("tick", "step", "datagram_out", "event", "account", "answer")]
    places.append([at for at, *_ in recorded.news()])
    at = data.draw(st.sampled_from(data.draw(st.sampled_from([each for each in places if each]))))
    verdict = verify(recorded.written([*recorded.messages[:at], *recorded.messages[at + 1 :]]))
    assert verdict.difference is not None, recorded.messages[at]
    assert verdict.difference.time_ns >= recorded.messages[at].time_ns


def test_a_client_that_ticks_without_a_welcome_is_said(anna: Recorded) -> None:
    """Its only cause is missing, so there is no seat that could be played."""
    welcome = anna.of("datagram_in")[0]
    with pytest.raises(RecordingError, match=r"changed\.mcap cannot be replayed: .*seat"):
        verify(anna.written([*anna.messages[:welcome], *anna.messages[welcome + 1 :]]))


@given(data=st.data())
def test_two_messages_that_changed_places_are_found(recorded: Recorded, data: st.DataObject) -> None:
    outputs = {"datagram_out", "event", "account", "answer"}
    drawn = {"tf", "scene", "forces"}  # for viewers: nothing is replayed from them, so they may stand anywhere
    both = [set(pair) for pair in pairwise(recorded.kinds)]
    pairs = [at for at, kinds in enumerate(both) if kinds & outputs and not kinds & drawn]
    at = data.draw(st.sampled_from(pairs))
    one, other = recorded.messages[at : at + 2]
    found = verify(recorded.written([*recorded.messages[:at], other, one, *recorded.messages[at + 2 :]])).difference
    assert found.time_ns >= one.time_ns


def _spoil(path: Path, chunk: int) -> Path:
    """Flip a byte in the middle of a chunk's data (MCAP: opcode u8, length u64)."""
    body, offset, chunks = bytearray(path.read_bytes()), 8, []
    while offset + 9 <= len(body):
        length = int.from_bytes(body[offset + 1 : offset + 9], "little")
        if body[offset] == 6:
            chunks.append(offset + 9 + length // 2)
        offset += 9 + length
    body[chunks[chunk]] ^= 0x55
    spoilt = path.with_name("spoilt.mcap")
    spoilt.write_bytes(body)
    return spoilt


@pytest.mark.parametrize("name", ["client-anna.mcap", "server.mcap"])
@pytest.mark.parametrize("chunk", [0, 1, -1])
def test_a_damaged_chunk_is_a_hole_and_all_before_it_is_equal(name: str, chunk: int, folder: Path) -> None:
    whole = open_recording(folder / name)
    chunks = list(whole.chunks())
    verdict = verify(open_recording(_spoil(folder / name, chunk)))
    assert isinstance(verdict.hole, Damage)
    assert "damaged chunk" in verdict.hole.reason
    assert not verdict.exact
    assert verdict.difference is None
    before = [message for each in chunks[:chunk] for message in each]
    assert verdict.messages <= len(before)
    assert verdict.ticks == sum(kind_of(whole.topics[message.topic]) in ("tick", "step") for message in before)
    assert verdict.hole_ns == (before[-1].time_ns if before else None)
    assert not verdict.cut, "it was closed"


@settings(max_examples=30)
@given(st.floats(0.0, 1.0))
def test_a_file_that_ends_anywhere_is_exact_to_there(folder: Path, part: float) -> None:
    body = (folder / "client-anna.mcap").read_bytes()
    path = folder / "ends.mcap"
    path.write_bytes(body[: round(part * len(body))])
    try:
        recording = open_recording(path)
    except RecordingError as error:
        assert "ends.mcap" in str(error)  # noqa: PT017
        return
    verdict = verify(recording)
    assert verdict.exact, verdict.difference
    assert verdict.cut == (part < 1.0 and round(part * len(body)) < len(body))


def test_other_versions_are_reported_and_all_is_compared_nevertheless(anna: Recorded) -> None:
    versions = msgspec.structs.replace(anna.header.versions, python="3.1.4", machine="pdp11")
    verdict = verify(anna.written(anna.messages, msgspec.structs.replace(anna.header, versions=versions)))
    assert [text.split(" -> ")[0] for text in verdict.versions] == ["python: 3.1.4", "machine: pdp11"]
    assert verdict.exact


def test_a_recording_of_something_else_is_refused(anna: Recorded) -> None:
    with pytest.raises(RecordingError, match="is of a 'witness'"):
        verify(anna.written(anna.messages, msgspec.structs.replace(anna.header, role="witness")))


def test_the_command_says_equal_or_where_not(folder: Path, anna: Recorded, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(folder / "client-anna.mcap"), "--verify"]) == 0
    assert "client-anna.mcap: equal, bit for bit" in capsys.readouterr().out
    at = anna.of("tick")[100]
    tick = msgspec.json.decode(anna.messages[at].payload, type=Tick)
    anna.altered(at, encode(msgspec.structs.replace(tick, work_j=0.125)))
    assert main(["replay", str(folder / "changed.mcap"), "--verify"]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "in /anna/tick work_j: recorded 0.125, replayed " in said
    assert f"differs at {100 / 1024:.6f} s" in said
    assert "was not closed" not in said
    assert main(["replay", str(folder / "client-anna.mcap"), "--verify", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["exact"]
