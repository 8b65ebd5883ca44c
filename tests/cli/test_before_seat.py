"""The trial of motors before `cogrip join` takes a seat: who is refused, what is said, and what is not tried."""

from collections.abc import Iterator

import pytest

from cogrip.cli.devices import tried_response
from cogrip.cli.devices.tried_response import SKIPPED, try_before_seat
from cogrip.cli.terminal.problem import Problem
from cogrip.devices.registry import make

from tests.devices.faulty_device import SIGN, FaultyDevice

RIGID = "hold&hand_stiffness_npm=20000&hand_damping_nspm=100"


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Have what is wrong with the next device in a list."""
    wrong = [""]
    monkeypatch.setattr(tried_response, "make", lambda address, axes: FaultyDevice(make(address, axes=axes), wrong[0]))
    return wrong


def test_a_seat_is_taken_with_a_device_that_is_well_alone(device: list[str]) -> None:
    said: list[str] = []
    text = try_before_seat("emulated:vintage?hand=hold", said.append, wanted=True)
    assert said == [f"emulated:vintage?hand=hold: {text}"]
    device[0] = SIGN
    with pytest.raises(
        Problem, match=r"refused: emulated:vintage\?hand=hold: x: it moves against its force: .*--no-trial"
    ):
        try_before_seat("emulated:vintage?hand=hold", said.append, wanted=True)
    assert (
        try_before_seat("emulated:vintage?hand=hold", said.append, wanted=False) == said[-1] == f"{SKIPPED}: --no-trial"
    )


def test_what_could_not_be_told_is_a_warning(device: list[str]) -> None:
    said: list[str] = []
    text = try_before_seat(f"emulated:vintage?hand={RIGID}", said.append, wanted=True)
    assert said[0].startswith("warning: ")
    assert "not determined" in text


@pytest.mark.parametrize(
    "address", ["sim:phantom?hand=reach", "web:pointer", "web", "replay:hand.csv#time=t_s", "gamepad:"]
)
def test_what_has_no_motors_is_not_tried(address: str) -> None:
    assert try_before_seat(address, lambda text: pytest.fail(text), wanted=True) == ""
