"""The Foxglove protocol: its messages, an independent client over a real socket, and whatever a client may send."""

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed

from cogrip.view.foxglove import SUBPROTOCOLS, FoxgloveError, FoxgloveSession, subprotocol
from cogrip.view.frames import HAND_KNOWN, PersonFrame, SceneFrame
from cogrip.view.playback import Playback
from cogrip.view.recording import RecordedView, open_view
from cogrip.view.scene import DrawnObject, PageScene, ScenePerson

from tests.foxglove_schemas import PUBLISHED, check_schema, check_value
from tests.view.foxglove_client import ENDED, PAUSE, PAUSED, PLAY, PLAYING, Client, connected
from tests.view.foxglove_server import serving
from tests.view.recorded_runs import recorded_run

ANNA = ScenePerson(0, "anna", "#0072B2", (-0.02, 0.0, 0.0))
BEN = ScenePerson(1, "ben", "#D55E00", (0.02, 0.0, 0.0))
LIVE = PageScene("demo", "live", 3, 128, 1024, DrawnObject("cube", "box", (0.04, 0.04, 0.04), 0.2), (ANNA, BEN))
FRAME = SceneFrame(
    3, 7, 1.5, (0.01, 0.02, 0.03), (0.0, 0.0, 0.0),
    (PersonFrame(0, "live", HAND_KNOWN, 3, (0.1, 0.2, 0.3), (0.01, 0.0, 0.0), (2.0, 0.0, 0.0), rtt_ms=48.0), PersonFrame(1)),
)  # fmt: skip
TOPICS = ("/scene", "/tf", "/forces", "/object", "/anna/state", "/ben/state")


@pytest.fixture(scope="module")
def view(tmp_path_factory: pytest.TempPathFactory) -> RecordedView:
    return open_view(recorded_run(tmp_path_factory.mktemp("runs") / "demo", 1.0))


def player(view: RecordedView) -> FoxgloveSession:
    duration_s = view.scene.duration_s or 0.0
    return FoxgloveSession(view.scene, view.began_ns, Playback(view.frames, view.scene.chunks, duration_s))


def subscribed(session: FoxgloveSession, *topics: str) -> dict[int, str]:
    """Subscribe; return the topics by subscription."""
    (advertised,) = (each for each in map(json.loads, session.opening()[:2]) if each["op"] == "advertise")
    numbers = {channel["topic"]: channel["id"] for channel in advertised["channels"]}
    wanted = [{"id": 50 + place, "channelId": numbers[topic]} for place, topic in enumerate(topics)]
    assert session.receive(json.dumps({"op": "subscribe", "subscriptions": wanted})) == []
    return {50 + place: topic for place, topic in enumerate(topics)}


def taken(messages: list[bytes], topics: dict[int, str]) -> dict[str, Any]:
    found = {}
    for message in messages:
        if message[0] == 1:
            found[topics[struct.unpack_from("<I", message, 1)[0]]] = json.loads(message[13:])
    return found


async def test_an_independent_client_plays_a_recording_with_its_own_bar(view: RecordedView) -> None:
    async with serving(lambda: player(view)) as address, connected(address) as client:
        assert client.info["capabilities"] == ["time", "playbackControl"]
        begin, end = (client.info[key] for key in ("dataStartTime", "dataEndTime"))
        span_s = end["sec"] - begin["sec"] + (end["nsec"] - begin["nsec"]) * 1e-9
        assert span_s == pytest.approx(view.scene.duration_s)
        assert {channel["topic"] for channel in client.channels.values()} == set(TOPICS)
        for channel in client.channels.values():
            if channel["schemaName"] in PUBLISHED:
                check_schema(json.loads(channel["schema"]), PUBLISHED[channel["schemaName"]])
        await client.subscribe(*TOPICS)
        while set(client.data) != set(TOPICS):  # paused: one frame is shown all the same
            await client.take()
        assert client.states[0].status == PAUSED
        answer = await client.control(PLAY, "first", speed=10.0)
        assert (answer.status, answer.speed, answer.sought) == (PLAYING, 10.0, False)
        while client.states[-1].status != ENDED:
            await client.take()
        middle_ns = view.began_ns + 500_000_000
        answer = await client.control(PAUSE, "second", seek_ns=middle_ns)
        assert (answer.status, answer.time_ns, answer.sought) == (PAUSED, middle_ns, True)
        before = len(client.times_ns)
        while len(client.times_ns) == before:
            await client.take()
        assert abs(client.times_ns[-1] - middle_ns) < 1e9 / 64
        check_data(client.data, view)


def check_data(data: dict[str, list[tuple[int, Any]]], view: RecordedView) -> None:
    frames = {view.began_ns + round(frame.time_s * 1e9): frame for frame in view.frames(0)}
    for topic, schema in (("/scene", "SceneUpdate"), ("/forces", "SceneUpdate"), ("/tf", "FrameTransforms")):
        for _, message in data[topic]:
            check_value(message, PUBLISHED[f"foxglove.{schema}"])
    assert len(data["/object"]) > 20
    for time_ns, message in data["/object"]:
        assert tuple(message["position_m"].values()) == frames[time_ns].position_m  # the recording's own numbers
    for time_ns, message in data["/anna/state"]:
        anna = frames[time_ns].people[0]
        assert tuple(message["hand_m"].values()) == anna.hand_m
        assert tuple(message["force_n"].values()) == anna.force_n
        assert (message["state"], message["lost"]) == (anna.state, anna.lost)
    for time_ns, message in data["/tf"]:
        places = {each["child_frame_id"]: tuple(each["translation"].values()) for each in message["transforms"]}
        assert places["demo/object"] == pytest.approx(frames[time_ns].position_m, abs=1e-7)


async def until_closed(client: Client) -> None:
    while True:
        await client.take()


async def test_a_client_that_is_none_is_told_why_and_the_next_is_served(view: RecordedView) -> None:
    async with serving(lambda: player(view)) as address:
        async with connected(address, "foxglove.sdk.v1") as client:
            await client.socket.send(b"\x03\x00")
            with pytest.raises(ConnectionClosed, match="no playback request"):
                await until_closed(client)
        async with connected(address) as client:
            await client.subscribe("/tf")
            while "/tf" not in client.data:
                await client.take()
            await client.unsubscribe("/tf")
            await client.socket.send(json.dumps({"op": "getParameters", "parameterNames": []}))
            while not client.statuses:
                await client.take()
            assert client.statuses[0]["message"] == "getParameters is not offered here"


def test_a_frame_is_told_to_those_who_asked() -> None:
    session = FoxgloveSession(LIVE, 10**9)
    assert session.messages(FRAME) == []
    topics = subscribed(session, "/scene", "/tf", "/forces", "/anna/state")
    messages = session.messages(FRAME)
    assert messages[0] == struct.pack("<BQ", 2, 2_500_000_000)
    assert all(struct.unpack_from("<Q", message, 5)[0] == 2_500_000_000 for message in messages[1:])
    found = taken(messages, topics)
    assert found.keys() == set(topics.values())
    places = {each["child_frame_id"]: tuple(each["translation"].values()) for each in found["/tf"]["transforms"]}
    assert places["demo/anna/hand"] == pytest.approx((0.08, 0.2, 0.3))  # where she holds the object
    assert places["demo/anna/proxy"] == pytest.approx((-0.01, 0.0, 0.0))
    assert not [name for name in places if name.startswith("demo/ben")]  # nobody has that seat
    assert {entity["id"] for entity in found["/scene"]["entities"]} == set(places)
    (forces,) = found["/forces"]["entities"]
    assert forces["arrows"][0]["shaft_length"] + forces["arrows"][0]["head_length"] == pytest.approx(0.02)
    assert [len(line["points"]) for line in forces["lines"]] == [2]
    assert found["/anna/state"]["rtt_ms"] == 48.0
    assert found["/anna/state"]["up_ms"] is None  # not known
    assert "/scene" not in taken(session.messages(FRAME), topics)  # unchanged: once a second
    assert "/scene" in taken(session.messages(replace(FRAME, time_s=2.6)), topics)


def test_who_joins_gets_a_channel_and_who_leaves_loses_it() -> None:
    session = FoxgloveSession(LIVE)
    subscribed(session, "/anna/state", "/ben/state")
    clara = ScenePerson(1, "clara", "#D55E00", (0.02, 0.0, 0.0))
    gone, come = map(json.loads, session.change(msgspec.structs.replace(LIVE, people=(ANNA, clara))))
    assert (gone["op"], len(gone["channelIds"])) == ("unadvertise", 1)
    assert [channel["topic"] for channel in come["channels"]] == ["/clara/state"]
    assert come["channels"][0]["id"] not in gone["channelIds"]
    assert len(session.messages(FRAME)) == 2  # the time, and anna
    assert session.change(msgspec.structs.replace(LIVE, people=(ANNA, clara))) == []


def test_a_live_session_is_not_played_back() -> None:
    session = FoxgloveSession(LIVE)
    assert json.loads(session.opening()[0])["capabilities"] == ["time"]
    (answer,) = session.receive(request(0, 1.0))
    assert "cannot be played back" in answer
    assert (session.due(1.0), session.next_s(1.0)) == ([], None)


def test_subprotocols() -> None:
    assert [subprotocol(["other", each]) for each in SUBPROTOCOLS] == list(SUBPROTOCOLS)
    assert subprotocol(["other"]) is subprotocol([]) is None


SUBSCRIBE = '{"op": "subscribe", "subscriptions": [%s]}'


def request(command: int, speed: float, seeks: int = 0, time_ns: int = 0, length: int = 0, rest: bytes = b"") -> bytes:
    return struct.pack("<BBfBQI", 3, command, speed, seeks, time_ns, length) + rest


REFUSED = [
    "", "{", "[]", "7", "{}", '{"op": 7}', '{"op": "dance"}', '{"op": "subscribe"}',
    SUBSCRIBE % '{"id": 1}', SUBSCRIBE % '{"id": "1", "channelId": 1}', '{"op": "unsubscribe", "subscriptionIds": 5}',
    "[" * 30_000, "x" * 70_000, "\ud800", b"", b"\x00", b"\xff\x01", b"\x03",
    request(2, 1.0), request(0, float("nan")), request(0, 0.0), request(0, 1.0, length=9),
    request(0, 1.0, length=1, rest=b"\xff"),
]  # fmt: skip


@pytest.mark.parametrize("message", REFUSED, ids=range(len(REFUSED)))
def test_what_is_not_of_the_protocol_is_refused(message: str | bytes) -> None:
    with pytest.raises(FoxgloveError):
        FoxgloveSession(LIVE).receive(message)


@pytest.mark.parametrize(
    ("subscription", "words"),
    [('{"id": 1, "channelId": 99}', "channel 99 is not there"), ('{"id": -1, "channelId": 1}', "is no u32"),
     ('{"id": 1, "channelId": 2}, {"id": 1, "channelId": 1}', "in use"),
     ('{"id": 1, "channelId": 1}, {"id": 2, "channelId": 1}', "has a subscription already")],
)  # fmt: skip
def test_a_subscription_that_cannot_be_had_is_told(subscription: str, words: str) -> None:
    (answer,) = FoxgloveSession(LIVE).receive(SUBSCRIBE % subscription)
    assert json.loads(answer)["op"] == "status"
    assert words in answer


NUMBERS = st.integers(-(2**33), 2**65) | st.sampled_from([1, 2, 3, 50])
ALIKE = st.fixed_dictionaries(
    {"op": st.sampled_from(["subscribe", "unsubscribe", "advertise", "fetchAsset", "?"])},
    optional={
        "subscriptions": st.lists(st.fixed_dictionaries({"id": NUMBERS, "channelId": NUMBERS}), max_size=3),
        "subscriptionIds": st.lists(NUMBERS, max_size=3),
    },
).map(json.dumps)
REQUEST = st.builds(
    request, st.integers(0, 3), st.floats(width=32), st.integers(0, 255), st.integers(0, 2**64 - 1), st.integers(0, 3),
    st.binary(max_size=3),
)  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(messages=st.lists(st.text() | st.binary() | ALIKE | REQUEST, max_size=12))
def test_no_message_does_more_than_raise_its_one_error(messages: list[str | bytes], view: RecordedView) -> None:
    for session in (player(view), FoxgloveSession(LIVE)):
        for now_s, message in enumerate(messages):
            try:
                answers = session.receive(message, float(now_s))
            except FoxgloveError:
                continue
            assert all(isinstance(answer, bytes) or json.loads(answer)["op"] == "status" for answer in answers)
            session.due(now_s + 0.5)
            session.messages(FRAME)


def test_the_recordings_that_are_kept_can_be_played() -> None:
    view = open_view(Path(__file__).parents[1] / "recordings" / "live")
    session = player(view)
    topics = subscribed(session, *TOPICS)
    found = taken([message for message in session.due(0.0) if isinstance(message, bytes)], topics)
    states = [found[f"/{name}/state"] for name in ("anna", "ben")]
    joining = [state for state in states if state["state"] == "joining"]
    assert joining, "at the first step somebody does not hold the object yet"
    assert all(state["hand_m"] == {"x": None, "y": None, "z": None} for state in joining)
