"""A recorded run as a view: its frames are the recording's numbers, bit for bit."""

import json
import shutil
from math import isnan, nan
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.reader import RecordedMessage
from cogrip.protocol.recording.records import Event, Step
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.settings.room import resolve
from cogrip.results.reading.records import open_run
from cogrip.server.recorder import server_topics, start_text
from cogrip.view.frames import HAND_KNOWN, SceneFrame, decode_chunk
from cogrip.view.recorded_events import client_event, server_event
from cogrip.view.recording import CHUNK_S, ViewError, open_view
from cogrip.view.scene import to_json

from tests.recording_files import rewrite, written
from tests.view.recorded_runs import recorded_run

RECORDINGS = Path(__file__).parents[1] / "recordings"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "demo"
    return recorded_run(folder, 11.5, playout={"redundancy": 1}, rates={"device_hz": 512})


def decoded(path: Path) -> list[SceneFrame]:
    """Return all frames of a run, as a page has them from its chunks."""
    view = open_view(path)
    found: list[SceneFrame] = []
    for number in range(view.scene.chunks):
        told, frames = decode_chunk(view.chunk(number), len(view.scene.people))
        assert told == number
        assert all(number * CHUNK_S <= frame.time_s < (number + 1) * CHUNK_S for frame in frames)
        found += frames
    return found


def padded(rows: Any) -> Any:
    """Return rows of numbers on three axes."""
    return np.pad(rows, ((0, 0), (0, 3 - rows.shape[1])))


def assert_same_bits(found: list[tuple[float, ...]], wanted: Any) -> None:
    assert np.array(found).tobytes() == np.ascontiguousarray(wanted).tobytes()


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["laboratory", "live", "made here"])
def test_every_frame_holds_the_numbers_of_the_recording_bit_for_bit(name: str, run: Path) -> None:
    folder = run if name == "made here" else RECORDINGS / name
    frames, records = decoded(folder), open_run(folder)
    assert records.server is not None
    topic = f"/room/{records.room()}/step"
    steps = records.server.columns(topic)
    chosen = steps["step"] % 2 == 0  # 128 Hz, and 64 are shown
    assert [frame.number for frame in frames] == steps["step"][chosen].tolist()
    times_s = steps["time_s"][chosen]
    assert [frame.time_s for frame in frames] == (times_s - steps["time_s"][0]).tolist()
    assert_same_bits([frame.position_m for frame in frames], padded(steps["object_m"][chosen]))
    assert_same_bits([frame.velocity_mps for frame in frames], padded(steps["object_mps"][chosen]))
    for seat, person in enumerate(records.names()):
        seated = steps[f"{person}.seated"][chosen] == 1
        here = [frame.people[seat] for frame, there in zip(frames, seated, strict=True) if there]
        assert {frame.people[seat].state for frame, there in zip(frames, seated, strict=True) if not there} <= {"free"}
        assert_same_bits([each.proxy_m for each in here], padded(steps[f"{person}.proxy_m"][chosen][seated]))
        assert_same_bits([each.force_n for each in here], padded(steps[f"{person}.force_n"][chosen][seated]))
        ticks = records.clients[person].columns("tick")
        newest = np.searchsorted(ticks["time_s"], times_s[seated], side="right") - 1
        known = (newest >= 0) & (times_s[seated] - ticks["time_s"][newest] <= 0.5)
        assert [bool(each.flags & HAND_KNOWN) for each in here] == known.tolist()
        ticking = [each for each, there in zip(here, known, strict=True) if there]
        newest = newest[known]
        assert_same_bits([each.hand_m for each in ticking], padded(ticks["position_m"][newest]))
        assert_same_bits([each.seen_m for each in ticking], padded(ticks["object_m"][newest]))
        assert [each.rtt_ms for each in ticking] == pytest.approx(ticks["rtt_ms"][newest], rel=1e-6, nan_ok=True)
        lost = ticks["lost"][newest] + steps[f"{person}.lost"][chosen][seated][known]
        assert [each.lost for each in ticking] == lost.tolist()


@pytest.mark.long
def test_a_chunk_is_the_same_whatever_was_read_before(run: Path) -> None:
    forwards, backwards = open_view(run), open_view(run)
    whole = [forwards.chunk(number) for number in range(forwards.scene.chunks)]
    assert [backwards.chunk(number) for number in reversed(range(backwards.scene.chunks))] == whole[::-1]
    with pytest.raises(ViewError, match="chunk 2 is not there; the recording has 2, from 0"):
        forwards.chunk(2)


def test_the_scene_says_who_holds_what(run: Path) -> None:
    scene = open_view(run).scene
    assert (scene.mode, scene.room, scene.axes) == ("recording", "demo", 3)
    assert (scene.network_hz, scene.device_hz) == (128, 512)
    assert (scene.object.kind, scene.object.shape, scene.object.mass_kg) == ("cube", "box", 0.2)
    assert [(person.seat, person.name) for person in scene.people] == [(0, "anna"), (1, "ben")]
    assert scene.people[0].anchor_m[0] < 0.0 < scene.people[1].anchor_m[0]
    assert (scene.duration_s, scene.chunks, scene.note) == (pytest.approx(11.5, abs=0.01), 2, "")
    joined = [("joined", "anna joined"), ("joined", "ben joined")]
    assert [(event.kind, event.text) for event in scene.events[:2]] == joined
    assert json.loads(to_json(scene))["type"] == "scene"


def test_hands_are_drawn_from_where_joining_put_them(run: Path, tmp_path: Path) -> None:
    """The recorded proxy of somebody who joined with the hand at 0.3 m: it began on the object."""
    shutil.copytree(run, tmp_path / "run")

    def elsewhere(kind: str, message: RecordedMessage) -> bytes:
        if kind != "step":
            return message.payload
        step = msgspec.json.decode(message.payload, type=Step)
        x, y, z = step.seats[0].proxy_m
        anna = msgspec.structs.replace(step.seats[0], proxy_m=((x or 0.0) + 0.3, y, z))
        return encode(msgspec.structs.replace(step, seats=(anna, step.seats[1])))

    rewrite(tmp_path / "run" / "server.mcap", elsewhere)
    (before, _), (after, _) = (open_view(folder).scene.people for folder in (run, tmp_path / "run"))
    assert after.anchor_m == pytest.approx((before.anchor_m[0] - 0.3, *before.anchor_m[1:]))


def test_loss_and_delay_are_those_of_the_link(run: Path) -> None:
    later = [frame for frame in decoded(run) if frame.time_s > 5.0]
    for seat in range(2):
        losses = [frame.people[seat].loss for frame in later]
        assert 0.02 < sum(losses) / len(losses) < 0.08  # 5 % each direction
        assert all(40.0 <= frame.people[seat].rtt_ms <= 80.0 for frame in later)
        assert all(frame.people[seat].buffer_down_ms > 0.0 for frame in later)


def test_without_the_server_the_object_is_where_the_client_saw_it(run: Path, tmp_path: Path) -> None:
    shutil.copy(run / "client-ben.mcap", tmp_path)
    view = open_view(tmp_path)
    assert view.scene.note.startswith("The server's recording is not here")
    frames = decoded(tmp_path)
    ticks = open_run(tmp_path).clients["ben"].columns("tick")
    chosen = ticks["tick"] % 8 == 0
    assert_same_bits([frame.position_m for frame in frames], ticks["object_m"][chosen])
    assert_same_bits([frame.people[0].hand_m for frame in frames], ticks["position_m"][chosen])
    assert all(isnan(each) for frame in frames for each in (*frame.velocity_mps, *frame.people[0].proxy_m))


def test_without_a_client_its_hand_is_not_known(run: Path, tmp_path: Path) -> None:
    shutil.copy(run / "client-ben.mcap", tmp_path)
    shutil.copy(run / "server.mcap", tmp_path)
    view = open_view(tmp_path)
    assert view.scene.note == "Not recorded here, so their hands are not known: anna."
    anna, ben = view.frames(0)[-1].people
    assert (anna.state, anna.flags & HAND_KNOWN, ben.flags & HAND_KNOWN) == ("live", 0, HAND_KNOWN)
    assert str(anna.hand_m) == str((nan, nan, nan))


def test_a_client_that_stops_is_silent_for_as_long_as_it_has_the_seat(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "run")
    rewrite(
        tmp_path / "run" / "client-anna.mcap", lambda _, message: message.payload if message.time_ns < 4e9 else None
    )
    states = {frame.time_s: frame.people[0].state for frame in decoded(tmp_path / "run")}
    assert {state for time_s, state in states.items() if 0.1 < time_s < 4.4} == {"live"}
    assert {state for time_s, state in states.items() if time_s > 4.6} == {"silent"}


def test_events_become_marks_without_addresses() -> None:
    names = ("ben", "ben 2")
    told = {
        "ben 2 joined": ("joined", "ben 2", " from 192.0.2.7:5 with sim:ideal"),
        "ben left: done": ("left", "ben", ""),
        "ben was kicked by the administrator: rude": ("kicked", "ben", ""),
        "ben has been silent for too long and lost the seat": ("lost", "ben", ""),
    }
    for text, (kind, who, address) in told.items():
        event = server_event(1.0, f"demo: {text}{address}", "demo", names)
        assert event is not None
        assert (event.kind, event.who, event.text) == (kind, who, text)
    assert server_event(1.0, "other: ben left: done", "demo", names) is None
    fault = client_event(2.0, "fault: the device stalled", "ben")
    assert fault is not None
    assert (fault.kind, fault.text) == ("fault", "ben: fault: the device stalled")


def test_what_cannot_be_shown_is_told_in_one_line(run: Path, tmp_path: Path) -> None:
    with pytest.raises(ViewError, match="there is no such run"):
        open_view(tmp_path / "nowhere")
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(ViewError, match="holds no recording that can be read"):
        open_view(empty)
    still = tmp_path / "server.mcap"
    settings = resolve({"name": "demo"})
    topics = server_topics(["demo"])
    header = Header("server", "server", start_text([settings], "t"), 128, 1, 0, True, versions_here(), topics, "demo")
    with written(still, header) as writer:
        writer.put(topics.index("/server/event"), 0, encode(Event("demo: nobody came")))
    with pytest.raises(ViewError, match="holds no motion"):
        open_view(still)
    damaged = tmp_path / "damaged"
    shutil.copytree(run, damaged)
    data = bytearray((damaged / "server.mcap").read_bytes())
    data[len(data) // 2 : len(data) // 2 + 70_000] = bytes(70_000)
    (damaged / "server.mcap").write_bytes(data)
    with pytest.raises(ViewError, match=r"is damaged at byte [0-9]+; `cogrip recover"):
        open_view(damaged)


@pytest.mark.long
def test_a_damaged_part_is_left_out_and_the_rest_is_shown(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "run")
    path = tmp_path / "run" / "server.mcap"
    data = bytearray(path.read_bytes())
    within = data.index(b"\x04\x00\x00\x00zstd", len(data) // 2) + 100  # a chunk, by how it is compressed
    data[within : within + 20] = bytes(20)
    path.write_bytes(data)
    whole = {frame.number: frame for frame in decoded(run)}
    frames = decoded(tmp_path / "run")
    assert 0 < len(whole) - len(frames) < 100
    for frame in frames:
        assert frame.position_m == whole[frame.number].position_m


def test_a_minute_of_three_leaves_room_for_the_page(run: Path) -> None:
    """All of it is to be under 5 MB: base64 makes four bytes of three, and the page itself takes 0.75 MB."""
    view = open_view(run)
    packed = sum(len(view.chunk(number)) for number in range(view.scene.chunks))
    a_minute = packed * 60.0 / (view.scene.duration_s or 1.0) * 3 / len(view.scene.people)
    assert a_minute * 4 / 3 < 4_250_000


def test_a_recording_that_is_cut_off_is_shown_as_far_as_it_goes(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "run")
    for path in (tmp_path / "run").glob("*.mcap"):
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 2])
    frames, whole = decoded(tmp_path / "run"), decoded(run)
    assert 200 < len(frames) < len(whole)
    assert [frame.position_m for frame in frames] == [frame.position_m for frame in whole[: len(frames)]]
