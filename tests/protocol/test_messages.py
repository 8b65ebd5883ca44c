"""The datagrams: round trip, sizes, and a decoder that lets nothing else through and raises nothing else."""

import math
from collections.abc import Iterator
from typing import Any, get_args

import msgpack
import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.machine.tick_count import TickCount
from cogrip.protocol.settings.effects import MOST_POINTS, Effect
from cogrip.protocol.settings.hand import HandChange, WorkspaceLimit
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.texts import TEXT_BYTES, clipped
from cogrip.protocol.wire import accounts, messages
from cogrip.protocol.wire.accounts import (
    REASON_BYTES,
    ClientAccount,
    DeviceAccount,
    PlayoutAccount,
    RoomAccount,
    SeatAccount,
)
from cogrip.protocol.wire.messages import HELLO_BYTES, VIEWED_SEATS, Hello, MalformedError, decode, encode, padded
from cogrip.protocol.wire.session import ClientSession, foreign_version, make_hello, nonce_of

from tests.protocol.valid_values import valid

BIG, MOST, EDGES = 2**63 - 1, 2**53, 2**32 - 1
WIDE = "\U0001f600"  # 4 bytes
WORDS = WIDE * 40
SECRET = "x" * 32
COUNT = accounts.LinkCount(*[BIG] * 7)
TIMES = accounts.Percentiles(0.1, 0.1, 0.1, 0.1)
ROW, DELAYS = (0.1, 0.1, 0.1), (1e5 + 0.1,) * 3
POSE = ROW + ROW
TURNED = (0.5, -0.5, 0.5, 0.5)
HANDLE = messages.Handle(2**32 - 1, (-32,) * 16, (65535,) * 16, TURNED, 0.1)
PLAYOUT = PlayoutAccount(0.1, 0.1, 0.1, *[BIG] * 4)
TICKS = TickCount(BIG, BIG, TIMES, TIMES)
CLIENT = ClientAccount(
    POSE, POSE, *[0.1] * 6, COUNT, TIMES, TICKS, True, "s" * 40, "r" * REASON_BYTES, 0.1, PLAYOUT,
    accounts.DelayAccount(TIMES, TIMES, 0.1, 0.1), DeviceAccount(True, 0.1, 0.1, 0.1, 0.1, BIG, 0.1, 0.1, 0.1), 0.1, 0.1,
    accounts.LineAccount(*[0.1] * 6), accounts.EffectAccount(0.1, 0.1, 0.1),
)  # fmt: skip
SEAT = SeatAccount(POSE, 0.1, 0.1, COUNT, PLAYOUT, 0.1, 0.1, 0.1)
ROOM = RoomAccount(POSE, POSE, 0.1, False, 0.1, TICKS)
STAMP = messages.Stamp(BIG, BIG, BIG)

LONGEST: dict[str, Any] = {
    "name": "r" * 40, "seed": 2**53, "rates": {"device_hz": 20_000, "network_hz": 20_000},
    "coupling": {"kind": "coupling", "compensate": True, "decimator": "lowpass", "encoder": "displacement"},
    "object": {"kind": "faces", "axes": 3}, "playout": {"frames": 256, "redundancy": 32},
    "users": [
        *({"name": f"u{number}"} for number in range(255)),
        {"name": "u" * 40, "side": "right", "force_scale": 0.3, "rotation": (0.1, 0.2, 0.3),
         "workspace_limit_m": "box -10 10 -10 10 -10 10", "gravity_compensation": True},
    ],
}  # fmt: skip
LONGEST_SEAT = seat_settings(resolve(LONGEST), 255)

LARGEST: dict[str, messages.AnyMessage] = {
    "hello": Hello(
        messages.MAGIC, MOST, WORDS, BIG, *[WORDS] * 4, 6, 1.1, 0.1, 0.1, "observer", *[SECRET] * 2, 0.1, 0.1
    ),
    "welcome": messages.Welcome(MOST, BIG, BIG, SECRET, WORDS, LONGEST_SEAT, SECRET, "observer"),
    "refuse": messages.Refuse(MOST, BIG, WORDS, "r" * TEXT_BYTES),
    "waves": messages.Waves(
        BIG, MOST, (0.1,) * 78, POSE, POSE, 0.1, 0.1, MOST, STAMP, (0.1,) * 15, -(2**31), MOST, 0.1, MOST, HANDLE, EDGES
    ),
    "state": messages.State(BIG, MOST, POSE, POSE, 0.1, MOST, STAMP, HANDLE, EDGES),
    "heartbeat": messages.Heartbeat(BIG, STAMP),
    "leave": messages.Leave(BIG, "r" * messages.LEAVE_TEXT_BYTES, CLIENT),
    "farewell": messages.Farewell(BIG, "r" * TEXT_BYTES, SEAT, ROOM),
    "view": messages.View(
        BIG, MOST, (0.1,) * 6, (255,) * VIEWED_SEATS, (0.1,) * (3 * VIEWED_SEATS), (0.1,) * (3 * VIEWED_SEATS), STAMP
    ),
    "power": messages.Power(BIG, MOST, POSE, POSE, POSE, POSE, POSE, 0.1, MOST, STAMP, HANDLE, EDGES),
    "person": messages.Person(
        BIG,
        MOST,
        255,
        WORDS,
        "joining",
        ROW,
        ROW,
        *DELAYS,
        *[MOST] * 4,
        *[0.1] * 4,
        EDGES,
        EDGES,
        TURNED,
        *[0.3] * 3,
        True,
    ),
    "bodies": messages.Bodies(BIG, MOST, messages.pack_poses([(1023, (*ROW, *TURNED))] * messages.MOST_POSES)),
    "geom": messages.Geom(BIG, 1024, 1023, "mesh", ROW, 1023, ROW, TURNED, (0.1,) * 4, 255, True, b"t" * 990),
    "mark": messages.Mark(BIG, MOST, "m" * messages.MARK_BYTES, MOST, 255, MOST),
    "set hand": messages.SetHand(
        BIG,
        MOST,
        MOST,
        HandChange(
            0.3, 0.3, TURNED, True, WorkspaceLimit("box", (-(10**7), 10**7) * 3), True, 9.1, 0.3, "balanced", 0.1, 0.1
        ),
    ),
    "effects": messages.Effects(
        BIG, MOST, (MOST,) * 16, 0.1, MOST, Effect("perturbation", ROW, ROW, ROW, (ROW,) * MOST_POINTS, *[0.1] * 8)
    ),
    "edges": messages.Edges(BIG, STAMP, HANDLE),
    "redirect": messages.Redirect(MOST, BIG, "p" * 60, ("f" * 60,) * messages.MOST_FRONTS),
    "restart": messages.Restart(BIG, messages.MOST_WAIT_MS),
    "note": messages.Note(BIG, messages.MOST_NOTES, messages.MOST_NOTES - 1, "n" * TEXT_BYTES),
}

short_texts = st.text(max_size=40)
texts = st.text(max_size=TEXT_BYTES)
quaternions = st.tuples(*[st.floats(0.1, 1.0)] * 4).map(lambda row: tuple(each / math.hypot(*row) for each in row))
poses = st.tuples(
    st.integers(0, 1023), st.tuples(*[st.floats(-1e3, 1e3)] * 3, quaternions).map(lambda row: (*row[:3], *row[3]))
)
edges = st.lists(st.tuples(st.integers(1, 32) | st.integers(-32, -1), st.integers(0, 65535)), max_size=16)
handles = st.builds(
    lambda first, edges, *rest: messages.Handle(first, *map(tuple, zip(*edges, strict=True) if edges else [(), ()]), *rest),
    st.integers(0, 2**32 - 1), edges, st.none() | quaternions, st.none() | st.floats(-1.0, 1.0),
)  # fmt: skip
given_structs: dict[type, st.SearchStrategy[Any]] = {
    messages.Handle: handles,
    SeatSettings: st.just(LONGEST_SEAT),
    WorkspaceLimit: st.sampled_from([WorkspaceLimit("auto"), WorkspaceLimit("sphere", (0, -1, 2, 3))]),
    HandChange: valid(HandChange, {WorkspaceLimit: st.just(WorkspaceLimit())}, rotation=st.none() | quaternions),
}
hellos = valid(Hello, padding=st.just(b""))
whole_messages = {
    Hello: hellos,
    messages.Person: valid(messages.Person, orientation=st.none() | quaternions),
    messages.Bodies: valid(messages.Bodies, poses=st.lists(poses, min_size=1, max_size=39).map(messages.pack_poses)),
    messages.Geom: valid(
        messages.Geom,
        orientation=quaternions,
        triangles=st.just(b""),
        colours=st.just(b""),
        points=st.just(b""),
        period_m=st.none(),
        kind=st.sampled_from(["box", "sphere", "plane", "mesh"]),
    ),
}
anything = st.one_of(
    [whole_messages[each] if each in whole_messages else valid(each, given_structs) for each in get_args(messages.AnyMessage)]
)  # fmt: skip


@given(anything)
def test_round_trip(message: messages.AnyMessage) -> None:
    datagram = encode(message)
    if len(datagram) <= messages.MAX_MESSAGE_BYTES:
        assert decode(datagram) == message
        assert encode(decode(datagram)) == datagram
    else:
        with pytest.raises(MalformedError, match="more than 1195"):
            decode(datagram)


def read(datagram: bytes) -> messages.AnyMessage | None:
    """Return the decoded message, None for MalformedError; any other error is a bug."""
    foreign_version(datagram)
    nonce_of(datagram)
    try:
        return decode(datagram)
    except MalformedError:
        return None


def numbers_of(value: Any) -> list[float]:
    """Every number that can reach a force or a buffer; the accounts are free."""
    if isinstance(value, ClientAccount | SeatAccount | RoomAccount):
        return []
    if isinstance(value, msgspec.Struct):
        value = msgspec.structs.astuple(value)
    if isinstance(value, tuple):
        return [number for item in value for number in numbers_of(item)]
    return [value] if isinstance(value, int | float) else []


def assert_harmless(message: messages.AnyMessage | None) -> None:
    if message is not None:
        assert all(math.isfinite(number) and abs(number) <= 2**63 for number in numbers_of(message))


@settings(max_examples=1000)
@given(st.sampled_from([encode(each) for each in LARGEST.values()]) | st.binary(max_size=1240), st.data())
def test_mutated_messages_and_any_bytes_are_malformed_or_harmless(begins: bytes, data: st.DataObject) -> None:
    datagram = bytearray(begins)
    for _ in range(data.draw(st.integers(0, 4))):
        place = data.draw(st.integers(0, len(datagram)))
        verb = data.draw(st.sampled_from(["set", "insert", "cut", "end"]))
        if verb == "set":
            datagram[place : place + 1] = data.draw(st.binary(min_size=1, max_size=1))
        elif verb == "insert":
            datagram[place:place] = data.draw(st.binary(max_size=9))
        elif verb == "cut":
            del datagram[place : place + data.draw(st.integers(1, 9))]
        else:
            del datagram[place:]
    assert_harmless(read(bytes(datagram)))


WRONG = [math.nan, math.inf, -math.inf, 2**64 - 1, -(2**63), 1e300, True, None, "x", "x" * 301, b"", [], [0] * 200, {}]


def altered(value: Any, wrong: Any) -> Iterator[Any]:
    """Yield a copy of a list or map for each place in it, at any depth, with the wrong value there."""
    items: Any = enumerate(value) if isinstance(value, list) else value.items() if isinstance(value, dict) else ()
    for key, item in items:
        for new in (wrong, *altered(item, wrong)):
            copy = value.copy()
            copy[key] = new
            yield copy


@pytest.mark.parametrize("name", LARGEST)
def test_a_wrong_value_in_any_place_is_malformed_or_harmless(name: str) -> None:
    good = msgpack.unpackb(encode(LARGEST[name]))
    for wrong in WRONG:
        for whole in altered(good, wrong):
            assert_harmless(read(msgpack.packb(whole)))


@pytest.mark.parametrize("nested", [b"\x91" * messages.MAX_DATAGRAM_BYTES, b"\x93\x01\xa6cogrip" + b"\x91" * 1200])
def test_deep_nesting_is_malformed_too(nested: bytes) -> None:
    assert read(nested) is None
    assert foreign_version(nested) is None


@pytest.mark.parametrize("letter", ["a", "é", WIDE])  # 1, 2 and 4 bytes
@pytest.mark.parametrize("secret", ["", SECRET])
def test_a_padded_hello_has_exactly_its_length_at_every_length_of_its_texts(letter: str, secret: str) -> None:
    for length in range(5 * 40 + 1):
        software, *texts = [letter * max(0, min(40, length - 40 * part)) for part in range(5)]
        hello = Hello(messages.MAGIC, 2**53, software, BIG, *texts, 6, 1.1, 0.1, 0.1, "observer", secret, secret)
        assert len(padded(hello)) == HELLO_BYTES


def test_a_hello_with_the_longest_token_fits_beside_any_names_and_answers_are_no_longer() -> None:
    token = "x" * messages.MOST_TOKEN
    names = ["n" * 40] * 4
    record = 6, 1.1, 0.1, 0.1, "observer"
    hello = Hello(
        messages.MAGIC, 1, *names[:1], BIG, *names[1:], WIDE * 50, *record, token, SECRET, 0.1, 0.1
    )  # fmt: skip
    assert len(padded(hello)) == 1126 <= messages.MAX_MESSAGE_BYTES
    assert decode(padded(hello)) == hello
    short = msgspec.structs.replace(hello, token="x" * 500)
    assert len(padded(short)) == HELLO_BYTES


def test_the_largest_legal_messages_are_read_and_fit_a_datagram_when_they_are_encrypted() -> None:
    assert messages.MAX_MESSAGE_BYTES + messages.DTLS_BYTES == messages.MAX_DATAGRAM_BYTES
    for message in LARGEST.values():
        legal = decode(padded(message)) if isinstance(message, Hello) else message
        assert decode(encode(legal)) == legal
    largest = {name: len(encode(message)) for name, message in LARGEST.items()}
    assert largest == {
        "hello": 964, "welcome": 1022, "refuse": 485, "waves": 1187, "state": 303, "power": 468, "heartbeat": 39, "leave": 1192,
        "farewell": 767, "view": 1008, "person": 424, "bodies": 1193, "geom": 1159, "mark": 122, "set hand": 168,
        "effects": 705, "edges": 161, "redirect": 579, "restart": 16, "note": 316,
    }  # fmt: skip
    proxied = msgspec.structs.replace(LARGEST["waves"], waves=(0.1,) * 72, state=(0.1,) * 18)
    assert len(encode(proxied)) == 1162, "of local contact with 6 axes, R = 12"
    assert max(largest["welcome"], largest["refuse"]) <= HELLO_BYTES, "no answer to anyone is longer than the hello"
    assert len(padded(LARGEST["hello"])) == HELLO_BYTES


@given(texts, short_texts, texts)
def test_a_leave_with_any_texts_fits_once_they_are_cut(reason: str, state: str, account_reason: str) -> None:
    account = msgspec.structs.replace(CLIENT, state=clipped(state), reason=clipped(account_reason, REASON_BYTES))
    leave = messages.Leave(BIG, clipped(reason, messages.LEAVE_TEXT_BYTES), account)
    assert len(encode(leave)) <= messages.MAX_MESSAGE_BYTES
    assert decode(encode(leave)) == leave


def test_a_session_leaves_with_the_longest_reason_and_the_largest_account() -> None:
    session = ClientSession(LARGEST["hello"])  # type: ignore[arg-type]
    session.state, session.welcome = "seated", LARGEST["welcome"]  # type: ignore[assignment]
    session.leave("r" * 1000, CLIENT, 0)
    [datagram] = session.outbox
    assert len(datagram) == 1192
    assert decode(datagram) == LARGEST["leave"]


def test_accounts_of_older_peers_have_no_reserves() -> None:
    whole = msgpack.unpackb(encode(LARGEST["leave"]))
    whole[3][17] = whole[3][17][:6]
    read = decode(msgpack.packb([*whole[:3], whole[3][:18]]))
    assert isinstance(read, messages.Leave)
    device = msgspec.structs.replace(CLIENT.device, reserve_j=None, budget_j=None, shake_n=None)
    assert read.account == msgspec.structs.replace(
        CLIENT, down_reserve_j=None, peak_torque_nm=0.0, device=device, line=None, effects=None
    )
    farewell = msgpack.unpackb(encode(LARGEST["farewell"]))
    farewell[3] = farewell[3][:6]
    seat = decode(msgpack.packb(farewell)).seat  # type: ignore[union-attr]
    assert seat == msgspec.structs.replace(SEAT, up_reserve_j=None, line_reserve_j=None)


def test_a_message_may_have_its_largest_size_and_not_a_byte_more() -> None:
    longest = LARGEST["hello"]
    assert isinstance(longest, Hello)
    fits = msgspec.structs.replace(longest, padding=bytes(messages.MAX_MESSAGE_BYTES - len(encode(longest))))
    assert len(encode(fits)) == messages.MAX_MESSAGE_BYTES
    assert decode(encode(fits)) == fits
    with pytest.raises(MalformedError, match="1196 bytes, more than 1195"):
        decode(encode(msgspec.structs.replace(fits, padding=fits.padding + b"\0")))


@given(st.text())
def test_clipped_texts_are_read(text: str) -> None:
    cut = clipped(text)
    assert len(cut.encode()) <= TEXT_BYTES
    assert text.encode("utf-8", "replace").decode().startswith(cut)
    assert decode(encode(messages.Refuse(1, 1, "c", cut))).reason == cut
    assert cut == text or len(text.encode("utf-8", "replace")) > TEXT_BYTES or "?" in cut


def test_an_account_with_numbers_that_are_not_finite_still_arrives() -> None:
    broken = msgspec.structs.replace(ROOM, position_m=(math.nan,), energy_balance_error_j=math.inf)
    farewell = decode(encode(messages.Farewell(1, "over", None, broken)))
    assert isinstance(farewell, messages.Farewell)
    assert farewell.room is not None
    assert math.isinf(farewell.room.energy_balance_error_j)


@pytest.mark.parametrize(
    "pose",
    [
        (1024, (*ROW, *TURNED)), (0, (1e4, 0.0, 0.0, *TURNED)), (0, (math.nan, 0.0, 0.0, *TURNED)),
        *((0, (*ROW, *turned, 0.0, 0.0)) for turned in ((1.0, 0.1), (0.0, 0.0), (math.nan, 0.0), (math.inf, 0.0))),
    ],
)  # fmt: skip
def test_a_pose_out_of_bounds_is_malformed(pose: tuple[int, tuple[float, ...]]) -> None:
    good = messages.pack_poses([(7, (*ROW, *TURNED))])
    assert read(msgpack.packb([12, 1, 0, good]))
    for wrong in (good + messages.pack_poses([pose]), good[:-1], good + b"\0", good * 40, b""):
        assert read(msgpack.packb([12, 1, 0, wrong])) is None
    if pose[1][3:] != TURNED:
        whole = msgpack.unpackb(encode(LARGEST["geom"]))
        assert read(msgpack.packb([*whole[:8], pose[1][3:], *whole[9:]])) is None


ADDRESSES = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=300)


@given(ADDRESSES, st.sampled_from(["", "anna", WORDS]), st.sampled_from(["", SECRET]))
def test_a_device_address_comes_whole_up_to_its_bound(device: str, name: str, secret: str) -> None:
    hello = make_hello(
        software=name, nonce=7, room=name, name=name, digest=name, device=device, axes=1, rate_hz=1e3, token=secret
    )
    datagram = padded(hello)
    assert len(datagram) == HELLO_BYTES, "whatever the texts are"
    read = decode(datagram)
    assert isinstance(read, Hello)
    assert read.device == clipped(device, messages.DEVICE_BYTES)
    assert padded(read) == datagram, "it can be said again"
