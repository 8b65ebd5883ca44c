"""Seats of hands with a gripper on the wire: who gets one, what a welcome of one is as long as, wrong ones."""

from typing import Any

import msgpack  # type: ignore[import-untyped]
import msgspec
import pytest
from msgspec.structs import replace

from cogrip.protocol.settings.coupling import Coupling
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.messages import HELLO_BYTES, MalformedError, Welcome, decode, encode
from cogrip.protocol.wire.session import ClientSession, unfit_axes

from tests.protocol.test_messages import LARGEST
from tests.protocol.two_ends import hello

GRIP = "grip_impedance_nspm"


LONGEST = LARGEST["welcome"]
assert isinstance(LONGEST, Welcome)


def welcome_of(axes: int, **coupling: Any) -> Welcome:
    """Return the longest welcome, to a seat of so many axes."""
    seat = LONGEST.settings  # type: ignore[union-attr]
    settings = replace(
        seat, coupling=replace(seat.coupling, **coupling), object=replace(seat.object, kind="scene", axes=axes)
    )
    return replace(LONGEST, settings=settings)  # type: ignore[return-value]


WELCOME = welcome_of(4, grip_impedance_nspm=0.1, rotational_impedance_nms=msgspec.UNSET)
"""The longest one to a seat with a gripper, which only a scene has."""


def test_the_longest_welcome_of_a_gripper_is_no_longer_than_a_hello() -> None:
    assert len(encode(WELCOME)) <= HELLO_BYTES
    assert decode(encode(WELCOME)) == WELCOME


def test_a_seat_without_a_gripper_has_no_word_of_one() -> None:
    """So a welcome of one, and the digest of its settings, are the bytes that they were before there were grippers."""
    thing = {"kind": "scene", "file": "x.xml", "axes": 3}
    plain, grips = (resolve({"object": thing, "users": [{"tool": tool}]}) for tool in ("pad", "pinch"))
    assert GRIP.encode() not in msgspec.msgpack.encode(seat_settings(plain, 0))
    assert GRIP.encode() in msgspec.msgpack.encode(seat_settings(grips, 0))
    assert digest(plain) != digest(grips)
    other = resolve({"object": thing, "users": [{"tool": "pinch"}], "coupling": {GRIP: 7.0}})
    assert digest(other) != digest(grips)
    assert seat_settings(other, 0).coupling.further_impedance == 7.0
    own = resolve({"object": thing, "users": [{"tool": "pinch", GRIP: 6.0}], "coupling": {GRIP: 7.0}})
    assert seat_settings(own, 0).coupling.further_impedance == 6.0


@pytest.mark.parametrize("axes", [1, 3, 6])
def test_a_welcome_of_other_axes_with_a_gripper_is_malformed(axes: int) -> None:
    whole = msgpack.unpackb(encode(WELCOME))
    whole[6][8]["axes"] = axes
    with pytest.raises(MalformedError, match="of turning, alone"):
        decode(msgpack.packb(whole))
    whole[6][8]["axes"] = 4
    del whole[6][6][GRIP]
    with pytest.raises(MalformedError, match="a seat of 4 axes needs"):
        decode(msgpack.packb(whole))


@pytest.mark.parametrize(("device", "seat"), [(3, 3), (4, 3), (6, 3), (4, 4), (6, 6), (3, 2), (4, 1)])
def test_a_device_takes_a_seat_of_its_axes_or_its_first_ones(device: int, seat: int) -> None:
    assert unfit_axes(hello(device_axes=device), seat) == ""


@pytest.mark.parametrize(
    ("device", "seat", "words"),
    [
        (3, 4, "no gripper with force"), (6, 4, "no gripper with force"), (1, 4, "no gripper with force"),
        (4, 6, "moves on 4 of the 6 axes"), (3, 6, "moves on 3 of the 6 axes"),
    ],
)  # fmt: skip
def test_a_seat_of_other_axes_is_refused_at_both_ends(device: int, seat: int, words: str) -> None:
    asked = hello(device_axes=device)
    assert words in unfit_axes(asked, seat)
    session = ClientSession(asked)
    session.connect(0)
    welcome = replace(WELCOME if seat == 4 else welcome_of(seat), nonce=7, ticket="", role="player")
    session.receive(encode(welcome), 1)
    assert session.welcome is None
    assert words in session.failed


@pytest.mark.parametrize(("axes", "impedance"), [(6, {"rotational_impedance_nms": 0.05}), (4, {GRIP: 0.05})])
def test_a_unit_behind_the_places_is_a_length_of_one_impedance(axes: int, impedance: dict[str, float]) -> None:
    coupling = Coupling(impedance_nspm=20.0, **impedance)  # type: ignore[arg-type]
    assert coupling.length_scale == pytest.approx(0.05)
    assert [coupling.fits(each) for each in (3, 4, 6)] == [axes == 6, axes == 4, axes == 6]
