"""Buttons, orientation and grip through a client: what is read, what is left out, what wrappers pass on."""

from collections import Counter
from dataclasses import replace
from math import nan
from types import SimpleNamespace
from typing import Any

import pytest

from cogrip.client.hand.further_axes import in_lengths
from cogrip.client.hand.handle import HandleReader, has_handle
from cogrip.client.hand.pose_axes import PoseAxes
from cogrip.devices import make
from cogrip.devices.device import Sample
from cogrip.devices.for_user import FirstAxes
from cogrip.protocol.wire.handle import Handle

TURNED, LEVEL = (0.5, 0.5, -0.5, 0.5), (1.0, 0.0, 0.0, 0.0)
RECORD = replace(make("sim:phantom", axes=3).capability, buttons=3, gives_orientation=True, grip_m=(0.0, 0.02))


def reader(**changes: Any) -> HandleReader:
    made = HandleReader(Counter())
    made.fit(replace(RECORD, **changes))
    return made


BARE: dict[str, Any] = {"gives_orientation": False, "grip_m": None}


def sample(buttons: int = 0, orientation: Any = None, grip_m: float | None = None) -> Sample:
    return Sample((0.0, 0.0, 0.0), None, 0, buttons, orientation, grip_m)


def test_edges_within_a_frame_are_told_at_once_twice_and_then_with_the_frame() -> None:
    """A button that changes at each tick sends no more than the server lets a peer send."""
    made = reader(**BARE)
    told = []
    for tick in range(8):
        made.read(sample(buttons=1 - tick % 2), tick)
        told.append(made.message_at_once(tick))
    assert told == [Handle(0, (1,), (0,)), Handle(0, (1, -1), (1, 0)), *[None] * 6]
    frame = made.message(8)
    assert frame is not None
    assert frame.edges == (1, -1) * 4
    assert made.message_at_once(8) is None, "the frame's message had all edges"
    made.read(sample(buttons=1), 9)
    assert made.message_at_once(9) == Handle(0, (1, -1) * 4 + (1,), (*range(9, 1, -1), 0))
    made.read(sample(buttons=1), 10)
    assert made.message_at_once(10) is None, "a button that stays down has no edge"


def test_what_the_record_does_not_have_is_not_read() -> None:
    bare = reader(buttons=0, **BARE)
    bare.read(sample(7, TURNED, 0.01), 0)
    assert bare.message(0) is None
    assert not bare.dropped
    some = reader(gives_orientation=False)
    some.read(sample(0b1110, TURNED, 0.01), 0)
    assert some.message(3) == Handle(0, (2, 3), (3, 3), None, 0.01), "the record has three buttons"


@pytest.mark.parametrize(
    ("orientation", "grip_m", "told"),
    [
        ((1.0, 0.0, 0.0, 0.03), 0.01, (True, True)), ((1.0, 0.0, 0.0, 0.04), 0.01, (False, True)),
        ((nan, 0.0, 0.0, 1.0), 0.01, (False, True)), ((0.0,) * 4, 0.01, (False, True)), ((0.6, 0.8, 0.0), 0.01, (False, True)),
        (TURNED, 0.022, (True, True)), (TURNED, 0.0221, (True, False)), (TURNED, -0.002, (True, True)),
        (TURNED, -0.0021, (True, False)), (TURNED, nan, (True, False)),
    ],
)  # fmt: skip
def test_both_sides_of_what_can_be(orientation: Any, grip_m: float, told: tuple[bool, bool]) -> None:
    """A quaternion's squares add up to 1 within 0.001; a gripper opens a tenth of its range beyond its record."""
    made = reader()
    made.read(sample(0, LEVEL, 0.005), 0)
    made.read(sample(0, orientation, grip_m), 1)
    assert made.dropped["implausible handle"] == told.count(False)
    message = made.message(1)
    assert message is not None
    assert message.orientation == (orientation if told[0] else LEVEL)
    assert message.grip_m == (grip_m if told[1] else 0.005)


def test_a_grip_is_never_beyond_what_a_message_can_say() -> None:
    """Else the server would refuse whole frames."""
    wide = reader(grip_m=(-5.0, 5.0))
    for grip_m, told in ((1.0, 1.0), (1.1, 1.0), (-1.0, -1.0), (-1.1, -1.0)):
        wide.read(sample(0, None, grip_m), 0)
        message = wide.message(0)
        assert message is not None
        assert message.grip_m == told


def test_a_device_without_a_handle_has_no_reader() -> None:
    assert not has_handle(make("sim:phantom", axes=3).capability)
    for change in ({"buttons": 1}, {"gives_orientation": True}, {"grip_m": (0.0, 0.1)}):
        assert has_handle(replace(make("sim:phantom", axes=3).capability, **change))  # type: ignore[arg-type]


def test_wrappers_pass_the_handle_on() -> None:
    given = Sample((0.0,) * 6, (0.0,) * 6, 2, 5, TURNED, 0.01)
    read = PoseAxes(0.1).lengths(given)
    assert (read.age_ticks, read.buttons, read.orientation, read.grip_m) == (2, 5, TURNED, 0.01)
    record = replace(make("sim:freeflyer", axes=6).capability, buttons=3, gives_orientation=True, grip_m=(0.0, 0.02))
    lengths = in_lengths(record, 0.1)
    assert (lengths.buttons, lengths.gives_orientation, lengths.grip_m) == (3, True, (0.0, 0.02))
    first = FirstAxes(SimpleNamespace(capability=record, read=lambda tick: given), 2)  # type: ignore[arg-type]
    assert first.read(0) == Sample((0.0, 0.0), (0.0, 0.0), 2, 5, TURNED, 0.01)
    assert has_handle(first.capability)
