"""A recorded client plays again bit by bit, whatever happened to it, and one altered field is found and named."""

import json
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cogrip.client.recorded import (
    ACCOUNT,
    COMMAND,
    DATAGRAM_IN,
    DATAGRAM_OUT,
    EVENT,
    KINDS,
    TICK,
    RecordedClient,
    client_topics,
    start_of,
)
from cogrip.devices.device import Capability, Sample
from cogrip.protocol import messages
from cogrip.protocol.accounts import Percentiles, TickCount
from cogrip.protocol.line import LineSender
from cogrip.protocol.messages import Farewell, Heartbeat, Refuse, Stamp, State, Waves, Welcome
from cogrip.protocol.rates import due_ns
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.reader import RecordingError, open_recording
from cogrip.protocol.recording.records import Command, Datagram, Gap, Tick
from cogrip.protocol.recording.sink import Held, encode
from cogrip.protocol.recording.writer import RecordingWriter
from cogrip.protocol.session import make_hello
from cogrip.protocol.settings import digest, resolve, seat_settings
from cogrip.sim.replay.verify import Verdict, verify

DEVICE_HZ, M = 1024, 8
START_NS = 1_000_000_000  # of tick 0
SESSION = 7
GAP = KINDS.index("gap")
Put = tuple[int, int, bytes]  # topic, time, payload


def capability(axes: int, gives_velocity: bool) -> Capability:
    return Capability(
        family="test", model="arm", axes=axes, workspace_m=((-1.0, 1.0),) * axes, peak_force_n=10.0,
        continuous_force_n=2.0, stiffness_npm=1e3, damping_nspm=10.0, slew_nps=math.inf, speed_mps=math.inf,
        resolution_m=0.0, apparent_mass_kg=0.1, rate_hz=8192, gives_velocity=gives_velocity,
    )  # fmt: skip


def flipped(datagram: bytes, place: int, bits: int) -> bytes:
    """One byte of it changed."""
    data = bytearray(datagram or b"x")
    data[place % len(data)] ^= bits
    return bytes(data)


class Live:
    """A recorded core called as the live loop calls it, and a server's words for it to hear."""

    def __init__(self, axes: int = 1, gives_velocity: bool = False, world: Mapping[str, Any] = {}) -> None:
        what = {"axes": axes, **world.get("object", {})}
        self.settings = resolve({**world, "object": what, "users": [{"name": "anna"}]})
        hello = make_hello(
            software="test", nonce=1, room="", name="anna", digest="", device="test", axes=axes, rate_hz=1024.0
        )  # fmt: skip
        self.core = RecordedClient(hello, capability(axes, gives_velocity))
        self.held = Held()
        self.core.record(self.held)
        self.axes, self.gives_velocity = axes, gives_velocity
        self.tick, self.now_ns = -1, 0
        self.heard = False
        self.line = LineSender(axes, 4)
        self.said: list[bytes] = [b""]

    @property
    def noted(self) -> list[Put]:
        return self.held.messages

    def welcome(self) -> bytes:
        seat = seat_settings(self.settings, 0)
        return messages.encode(Welcome(1, 1, SESSION, digest(self.settings), "test", seat))

    def sit(self) -> None:
        self.core.call(self.now_ns)
        self.core.receive(self.welcome(), self.now_ns)
        self.now_ns += 300_000_000
        self.core.keep_seat(self.now_ns)

    def frame(self, value: float) -> bytes:
        """The next frame of the line down."""
        self.line.push((value,) * self.axes)
        first, waves, total, squares = self.line.contents()
        row = (value * 0.01,) * self.axes
        stamp = Stamp(self.now_ns + 1, max(0, self.now_ns - 5_000_000), 1_000_000)
        if self.settings.coupling.kind == "coupling":
            return messages.encode(State(SESSION, self.line.next_number - 1, row, row, 0.0, 0, stamp))
        return messages.encode(Waves(SESSION, first, waves, total, squares, 0.0, 0.0, 0, stamp, row + row))

    def word(self, kind: str, number: int, value: float) -> bytes:
        """A datagram as it may arrive; `number` tells which of that kind."""
        stamp, row, said = Stamp(number * 1000), (value,) * self.axes, self.said[number % len(self.said)]
        raw = {
            "again": said,
            "flipped": flipped(said, number, 1 << number % 8),
            "cut": said[: number % 60],
            "garbage": number.to_bytes(8, "big") * (number % 20),
            "too long": bytes(2000),
            "welcome": self.welcome(),
        }
        largest, total, squares = (
            tuple(1e4 * each for each in row),
            tuple(1e15 * each for each in row),
            (1e15,) * self.axes,
        )
        made = {
            "stranger": Heartbeat(SESSION + 1 + number, stamp),
            "heartbeat": Heartbeat(SESSION, stamp),
            "state": State(SESSION, number, row, row, value, 0, stamp),
            "hostile": Waves(SESSION, number, largest, total, squares, 0.0, 0.0, number, stamp, row + row),
            "farewell": Farewell(SESSION, "enough"),
            "refuse": Refuse(1, 1, "full", "the room is full"),
        }
        datagram = self.frame(value) if kind == "next" else raw[kind] if kind in raw else messages.encode(made[kind])
        self.said.append(datagram)
        return datagram

    def run_tick(self, gap: int, sample: Sample | None, words: Sequence[tuple[str, int, float]] = ()) -> None:
        core = self.core
        if self.heard:  # what came since the last tick; a live loop calls the core before it ticks again
            core.keep_seat(self.now_ns)
        self.heard = False
        self.tick += gap
        now_ns = self.now_ns = due_ns(START_NS, self.tick, DEVICE_HZ) + gap * 1000  # late, as live ticks are
        core.sense(self.tick, sample, now_ns)
        for word in words:
            core.receive(self.word(*word), now_ns)
        core.timing = (gap, self.tick % 50, self.tick // 100)
        core.act(now_ns)
        core.outbox.clear()

    def sample(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> Sample:
        velocity = tuple(velocity_mps[: self.axes]) if self.gives_velocity else None
        return Sample(tuple(position_m[: self.axes]), velocity)

    def run(self, ticks: int, answered: bool = True) -> None:
        """A hand that swings, and a server that answers or has fallen silent."""
        for _ in range(ticks):
            phase = 0.02 * (self.tick + 1)
            place, speed = 0.02 * math.sin(phase), 0.02 * 0.02 * DEVICE_HZ * math.cos(phase)
            words = [("next", 0, 0.2 * math.cos(phase))] if answered and (self.tick + 1) % M == 0 else []
            self.run_tick(1, self.sample((place,) * 3, (speed,) * 3), words)

    def end(self, reason: str) -> None:
        account = self.core.account(TickCount(self.tick + 1, self.tick + 1, Percentiles(1.0, 2.0, 3.0, 4.0)))
        self.core.leave(reason, account, self.now_ns)

    def poll(self, later_ns: int, words: Sequence[tuple[str, int, float]] = ()) -> None:
        self.now_ns += later_ns
        self.core.poll(self.now_ns)
        for word in words:
            self.core.receive(self.word(*word), self.now_ns)
            self.heard = True

    def verdict(self, noted: Sequence[Put] | None = None, closed: bool = True) -> Verdict:
        """Write `noted` (else all that was noted) to a file, and verify that."""
        header = Header(
            "client", "anna", self.core.start, DEVICE_HZ, 1, 5, True, versions_here(), client_topics("anna")
        )  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "client-anna.mcap"
            with path.open("wb") as file:
                writer = RecordingWriter(file, header)
                for message in self.noted if noted is None else noted:
                    writer.put(*message)
                if closed:
                    writer.finish()
                else:
                    writer.flush()
            return verify(open_recording(path))

    def exact(self) -> None:
        verdict = self.verdict()
        assert verdict.exact, verdict.difference
        assert verdict.messages == len(self.noted)
        assert verdict.ticks == sum(topic == TICK for topic, *_ in self.noted)
        assert not verdict.cut
        assert verdict.versions == ()


FINITE = st.floats(-0.1, 0.1)
STRANGE = st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, 1e200, 5e-324, -0.0, 2.0])
NUMBERS = st.integers(0, 9).flatmap(lambda chance: STRANGE if chance == 0 else FINITE)
THREE = st.tuples(NUMBERS, NUMBERS, NUMBERS)


def words(*kinds: str, most: int = 3) -> st.SearchStrategy[list[tuple[str, int, float]]]:
    """For `Live.word`."""
    return st.lists(st.tuples(st.sampled_from(kinds), st.integers(0, 300), st.floats(-1.0, 1.0)), max_size=most)


NOISE = ("garbage", "stranger", "heartbeat", "hostile")
WORDS = words("next", "next", "next", "again", "flipped", "cut", "too long", "state", "welcome", *NOISE)
LAST_WORDS = words("farewell", "refuse", "garbage", "cut", "stranger", "hostile", most=1)
REASONS = st.text(max_size=20)
GAPS = st.sampled_from([1] * 8 + [2, 8, 9, 50, 120, 2500])
LATER_NS = st.sampled_from([0, 2_000_000, 2_000_000, 90_000_000, 260_000_000, 1_500_000_000])
BEFORE = st.lists(st.tuples(LATER_NS, words(*NOISE)), max_size=3)
ACTIONS = st.lists(
    st.one_of(
        st.tuples(st.just("tick"), GAPS, st.none() | st.tuples(THREE, THREE), WORDS),
        st.tuples(st.just("run"), st.integers(8, 150), st.booleans()),
        st.tuples(st.just("poll"), LATER_NS, WORDS | LAST_WORDS),
        st.tuples(st.sampled_from(["fail", "end"]), REASONS),
        st.tuples(st.sampled_from(["stop", "rearm", "keep_seat"])),
    ),
    min_size=4, max_size=25,
)  # fmt: skip
WORLDS: list[dict[str, dict[str, Any]]] = [
    {},
    {"coupling": {"decimator": "lowpass", "encoder": "velocity", "server_step": "paper"}},
    {"coupling": {"decimator": "none"}, "object": {"kind": "wall"}},
    {"coupling": {"kind": "coupling"}},
]
LIVES = st.builds(Live, st.integers(1, 3), st.booleans(), st.sampled_from(WORLDS))


def played(live: Live, before: Sequence[Any], last: Sequence[Any], actions: Sequence[Any]) -> None:
    core = live.core
    core.call(0)
    for later_ns, words in before:
        live.poll(later_ns, words)
    live.poll(2_000_000, [*last, ("welcome", 0, 0.0)])
    for action in actions if core.seated else ():
        match action:
            case "tick", gap, sample, words:
                live.run_tick(gap, None if sample is None else live.sample(*sample), words)
            case "run", ticks, answered:
                live.run(ticks, answered)
            case "poll", later_ns, words:
                live.poll(later_ns, words)
            case "fail", reason:
                core.fail(reason)
            case "keep_seat", *_:
                core.keep_seat(live.now_ns)
            case "end", reason:
                live.end(reason)
            case verb, *_:
                getattr(core, verb)()


@settings(max_examples=300)
@given(LIVES, BEFORE, LAST_WORDS, ACTIONS)
def test_whatever_happened_plays_again_exactly(
    live: Live, before: list[Any], last: list[Any], actions: list[Any]
) -> None:
    played(live, before, last, actions)
    live.exact()


@given(LIVES, ACTIONS, st.floats(0.0, 1.0))
def test_whatever_is_left_of_a_cut_recording_plays_exactly(live: Live, actions: list[Any], part: float) -> None:
    """A chunk may end between any two messages: between what a tick sent and the tick itself, too."""
    played(live, [], [], actions)
    left = live.noted[: round(part * len(live.noted))]
    verdict = live.verdict(left, closed=False)
    assert verdict.difference is None
    assert verdict.exact
    assert verdict.cut
    assert verdict.ticks == sum(topic == TICK for topic, *_ in left)


def test_every_beginning_of_a_recording_plays_exactly() -> None:
    live = scripted()
    for length in range(len(live.noted)):
        verdict = live.verdict(live.noted[:length], closed=False)
        assert verdict.exact, (length, verdict.difference)
        assert verdict.cut


@given(st.integers(0, 400))
def test_nothing_after_a_gap_is_judged_and_all_before_it_is(at: int) -> None:
    live = scripted()
    at = min(at, len(live.noted))
    gap = (GAP, live.noted[min(at, len(live.noted) - 1)][1], encode(Gap(3, "the ring was full")))
    verdict = live.verdict([*live.noted[:at], gap, *live.noted[at + 3 :]])
    assert verdict.difference is None
    assert verdict.hole == Gap(3, "the ring was full")
    assert verdict.hole_ns == gap[1]
    assert not verdict.exact
    assert not verdict.cut, "the file was closed"
    assert verdict.ticks == sum(topic == TICK for topic, *_ in live.noted[:at])


def scripted() -> Live:
    """Every kind of message, every command, every state."""
    live = Live(2, gives_velocity=False)
    live.poll(0, [("garbage", 3, 0.0)])
    live.sit()
    live.run(60)
    live.run_tick(1, Sample((math.nan, 0.0), None))
    live.run(5)
    live.core.rearm()
    live.run(30)
    live.run_tick(300, live.sample((0.01, 0.01), ()))  # the watchdog
    live.core.rearm()
    live.run(40)
    live.core.fail("device: unplugged")
    live.run_tick(1, None)
    live.core.stop()
    live.run(10)
    live.end("the session is over")
    live.poll(100_000_000)
    live.poll(1_000_000, [("farewell", 0, 0.0)])
    return live


def test_a_scripted_session_has_everything() -> None:
    live = scripted()
    live.exact()
    kinds = {KINDS[topic] for topic, *_ in live.noted}
    assert kinds == {"tick", "datagram_in", "datagram_out", "command", "event", "account"}
    verbs = [msgspec.json.decode(payload, type=Command).verb for topic, _, payload in live.noted if topic == COMMAND]
    assert set(verbs) == {"call", "poll", "keep_seat", "rearm", "fail", "stop", "account", "leave"}
    texts = [json.loads(payload)["text"] for topic, _, payload in live.noted if topic == EVENT]
    assert [text.split(":")[0] for text in texts] == [
        "live", "fault", "live", "fault", "degraded", "live", "fault", "idle",
    ]  # fmt: skip
    assert all(one <= other for one, other in pairwise(time for _, time, _ in live.noted))


SCRIPT = scripted()
OUTPUTS = [at for at, (topic, *_) in enumerate(SCRIPT.noted) if topic in (DATAGRAM_OUT, EVENT, ACCOUNT)]
TICKS = [at for at, (topic, *_) in enumerate(SCRIPT.noted) if topic == TICK]


def altered(at: int, payload: bytes, time_ns: int | None = None) -> Verdict:
    topic, now_ns, _ = SCRIPT.noted[at]
    new = (topic, now_ns if time_ns is None else time_ns, payload)
    return SCRIPT.verdict([*SCRIPT.noted[:at], new, *SCRIPT.noted[at + 1 :]])


def next_float(value: float) -> float:
    """The least change there is."""
    return math.nextafter(value, math.inf)


TICK_OUTPUTS = ("velocity_mps", "force_n", "wave_up", "wave_down", "object_m", "work_j", "port_j", "margin_j", "rtt_ms")


@given(st.sampled_from(TICKS), st.sampled_from(TICK_OUTPUTS), st.integers(0, 1))
def test_the_last_bit_of_any_number_of_a_tick_is_found(at: int, field: str, axis: int) -> None:
    _, time_ns, payload = SCRIPT.noted[at]
    tick = msgspec.json.decode(payload, type=Tick)
    value = getattr(tick, field)
    where = field
    if isinstance(value, tuple):
        assume(value[axis] is not None)
        old, new = value[axis], next_float(value[axis])
        value = tuple(new if number == axis else each for number, each in enumerate(value))
        where = f"{field}[{axis}]"
    else:
        assume(value is not None)
        old, new = value, next_float(value)
        value = new
    verdict = altered(at, encode(msgspec.structs.replace(tick, **{field: value})))
    found = verdict.difference
    assert found is not None
    assert not verdict.exact
    assert (found.time_ns, found.topic, found.field) == (time_ns, "/anna/tick", where)
    assert (float(found.recorded), float(found.replayed)) == (new, old)
    assert verdict.messages == at, "all before it is the same"
    assert not verdict.cut, "the file was closed"


@pytest.mark.parametrize(("field", "value"), [("state", "armed"), ("lost", 1000)])
def test_state_and_losses_of_a_tick_are_compared(field: str, value: str | int) -> None:
    at = TICKS[40]
    tick = msgspec.json.decode(SCRIPT.noted[at][2], type=Tick)
    found = altered(at, encode(msgspec.structs.replace(tick, **{field: value}))).difference
    assert found is not None
    assert (found.time_ns, found.field) == (SCRIPT.noted[at][1], field)
    assert found.recorded == json.dumps(value)


def test_the_sign_of_a_zero_is_a_difference() -> None:
    at = TICKS[0]
    tick = msgspec.json.decode(SCRIPT.noted[at][2], type=Tick)
    assert tick.wave_up == (0.0, 0.0)
    found = altered(at, encode(msgspec.structs.replace(tick, wave_up=(0.0, -0.0)))).difference
    assert found is not None
    assert (found.field, found.recorded, found.replayed) == ("wave_up[1]", "-0.0", "0.0")


@given(
    st.sampled_from([at for at in OUTPUTS if SCRIPT.noted[at][0] == DATAGRAM_OUT]),
    st.integers(0, 2**20),
    st.integers(1, 255),
)
def test_any_bit_of_a_datagram_that_was_sent_is_found(at: int, place: int, flip: int) -> None:
    _, time_ns, payload = SCRIPT.noted[at]
    data = bytearray(msgspec.json.decode(payload, type=Datagram).data)
    data[place % len(data)] ^= flip
    new = encode(Datagram(bytes(data)))
    found = altered(at, new).difference
    assert found is not None
    assert (found.time_ns, found.topic, found.field) == (time_ns, "/anna/datagram_out", "data")
    assert json.loads(found.recorded) == json.loads(new)["data"]
    assert json.loads(found.replayed) == json.loads(payload)["data"]


@given(st.sampled_from(OUTPUTS), st.sampled_from([-1, 1, 1000]))
def test_the_time_of_any_output_is_compared(at: int, later_ns: int) -> None:
    topic, time_ns, payload = SCRIPT.noted[at]
    assume(time_ns + later_ns >= 0)
    found = altered(at, payload, time_ns + later_ns).difference
    assert found is not None
    assert (found.field, found.recorded, found.replayed) == ("time_ns", str(time_ns + later_ns), str(time_ns))
    assert found.topic == client_topics("anna")[topic]


@pytest.mark.parametrize(("topic", "field"), [(EVENT, "text"), (ACCOUNT, "account")])
def test_events_and_accounts_are_compared(topic: int, field: str) -> None:
    for at in [at for at in OUTPUTS if SCRIPT.noted[at][0] == topic]:
        _, time_ns, payload = SCRIPT.noted[at]
        before = json.loads(payload)[field]
        found = altered(at, encode({field: before + " "})).difference
        assert found is not None
        assert (found.time_ns, found.topic, found.field) == (time_ns, client_topics("anna")[topic], field)
        assert (json.loads(found.recorded), json.loads(found.replayed)) == (before + " ", before)


def _command(verb: str, times: int = 0) -> int:
    """Where the command with this verb stands."""
    found = [
        at
        for at, (topic, _, payload) in enumerate(SCRIPT.noted)
        if topic == COMMAND and msgspec.json.decode(payload, type=Command).verb == verb
    ]
    return found[times]


@pytest.mark.parametrize(
    ("verb", "change", "topic", "field"),
    [
        ("call", {"verb": "poll"}, DATAGRAM_OUT, ""),  # the hello was sent, and is not now
        ("keep_seat", {"verb": "poll"}, DATAGRAM_OUT, ""),
        ("fail", {"reason": "device: burnt"}, EVENT, "text"),
        ("rearm", {"verb": "poll"}, TICK, "force_n[0]"),
        ("stop", {"verb": "poll"}, TICK, "force_n[0]"),
        ("leave", {"reason": "I am bored"}, DATAGRAM_OUT, "data"),
        ("account", {"ticks": msgspec.json.encode(TickCount(1, 1)).decode()}, ACCOUNT, "account"),
    ],
)  # fmt: skip
def test_another_command_is_found_by_what_comes_of_it(
    verb: str, change: dict[str, str], topic: int, field: str
) -> None:
    at = _command(verb)
    new = msgspec.structs.replace(msgspec.json.decode(SCRIPT.noted[at][2], type=Command), **change)
    verdict = altered(at, encode(new))
    found = verdict.difference
    assert found is not None
    following = next(number for number in range(at + 1, len(SCRIPT.noted)) if SCRIPT.noted[number][0] == topic)
    assert verdict.messages >= at
    assert found.time_ns == SCRIPT.noted[following][1]
    assert (found.topic, found.field) == (client_topics("anna")[topic], field)
    assert found.recorded != found.replayed


def test_a_wave_that_was_heard_otherwise_is_found_where_it_is_played() -> None:
    at = [number for number, (topic, *_) in enumerate(SCRIPT.noted) if topic == DATAGRAM_IN][4]
    heard = messages.decode(msgspec.json.decode(SCRIPT.noted[at][2], type=Datagram).data)
    assert isinstance(heard, Waves)
    wave = (*heard.waves[:-1], next_float(heard.waves[-1]))
    found = altered(at, encode(Datagram(messages.encode(msgspec.structs.replace(heard, waves=wave))))).difference
    assert found is not None
    assert (found.time_ns, found.topic, found.field) == (SCRIPT.noted[at][1], "/anna/tick", "wave_down[1]")
    assert float(found.replayed) == next_float(float(found.recorded))


@given(st.sampled_from(TICKS[5:50]), st.integers(0, 1))
def test_a_hand_that_was_elsewhere_is_found_at_that_tick(at: int, axis: int) -> None:
    _, time_ns, payload = SCRIPT.noted[at]
    tick = msgspec.json.decode(payload, type=Tick)
    assert tick.position_m is not None
    place = tuple(each + 1e-9 if number == axis else each for number, each in enumerate(tick.position_m))  # type: ignore[operator]
    found = altered(at, encode(msgspec.structs.replace(tick, position_m=place))).difference
    assert found is not None
    border = tick.tick % M == 0  # then the frame was sent before the tick was noted
    where = ("/anna/datagram_out", "data") if border else ("/anna/tick", f"velocity_mps[{axis}]")
    assert (found.time_ns, found.topic, found.field) == (time_ns, *where)


@given(st.sampled_from([*TICKS[5:], *OUTPUTS]))
def test_a_message_that_is_left_out_is_found(at: int) -> None:
    time_ns = SCRIPT.noted[at][1]
    verdict = SCRIPT.verdict([*SCRIPT.noted[:at], *SCRIPT.noted[at + 1 :]])
    assert verdict.difference is not None
    assert verdict.difference.time_ns >= time_ns
    assert verdict.messages >= sum(each < time_ns for _, each, _ in SCRIPT.noted), "all before it is the same"


@given(st.integers(0, len(SCRIPT.noted) - 2))
def test_two_messages_that_changed_places_are_found(at: int) -> None:
    one, other = SCRIPT.noted[at : at + 2]
    assume(one[0] in (TICK, DATAGRAM_OUT, EVENT, ACCOUNT) or other[0] in (TICK, DATAGRAM_OUT, EVENT, ACCOUNT))
    verdict = SCRIPT.verdict([*SCRIPT.noted[:at], other, one, *SCRIPT.noted[at + 2 :]])
    assert verdict.difference is not None
    assert verdict.difference.time_ns >= one[1]


STRANGE_PAYLOADS = st.sampled_from(
    [b"", b"{}", b"[]", b"null", b'{"verb":"fly"}', b'{"verb":"leave"}', b'{"data":"?"}']
)


@given(st.integers(0, 400), st.binary(max_size=40) | STRANGE_PAYLOADS)
def test_what_is_no_message_gives_a_verdict_or_a_refusal_in_words(at: int, payload: bytes) -> None:
    refused, verdict = "", None
    try:
        verdict = altered(at % len(SCRIPT.noted), payload)
    except RecordingError as error:
        refused = str(error)
    assert "client-anna.mcap cannot be replayed" in refused if verdict is None else not verdict.exact


@pytest.mark.parametrize(
    "start", ["", "{", "[]", "{}", '{"hello": 3, "capability": {}}', '{"hello": [], "capability": []}']
)
def test_a_start_that_is_none_is_refused_in_words(start: str) -> None:
    live = Live()
    live.core.start = start
    with pytest.raises(RecordingError, match=r"client-anna.mcap cannot be replayed"):
        live.verdict()


@given(st.integers(1, 3), st.floats(0.0, allow_nan=False), st.booleans())
def test_a_core_starts_from_what_the_header_says(axes: int, limit: float, gives_velocity: bool) -> None:
    """A device's bounds may be infinite."""
    live, record = Live(axes), replace(capability(axes, gives_velocity), slew_nps=limit, speed_mps=limit)
    hello, _ = start_of(live.core.start)
    assert start_of(RecordedClient(hello, record).start) == (hello, record)


def test_nothing_is_lost_before_it_is_known_where_it_goes() -> None:
    """A live client has a file only once it has a seat; its first hello is recorded all the same."""
    at_once, later = Live(), Live()
    later.core = RecordedClient(*start_of(at_once.core.start))
    for live in (at_once, later):
        live.sit()
    later.core.record(later.held)
    for live in (at_once, later):
        live.run(20)
    assert later.noted == at_once.noted
    assert msgspec.json.decode(later.noted[0][2], type=Command).verb == "call"
