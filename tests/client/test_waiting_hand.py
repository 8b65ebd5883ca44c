"""Simulated hands that wait until everybody holds on."""

import pytest

from cogrip.client.markers import OwnMarkers
from cogrip.client.waiting_hand import MOST_WAIT_S, WaitingHand
from cogrip.devices.registry import make
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.protocol.settings.task import EVERYBODY
from cogrip.protocol.wire.messages import Mark

RATE_HZ = 1000
PUSHED_N = [0.3, 0.0, 0.0]


def device() -> SimulatedDevice:
    address = "sim:ideal?hand=grasp&gap_m=0.04&press_n=5&lift_m=0.05&start_s=0.01&stroke_s=0.1&press=2@0.02+0.03"
    found = make(address, axes=3)
    assert isinstance(found, SimulatedDevice)
    found.open(RATE_HZ)
    return found


@pytest.mark.parametrize("waited", [0, 1, 137])
def test_the_same_motion_begins_later(waited: int) -> None:
    """Without a force nothing moves while it waits; then every sample is that of a hand that did not."""
    late, at_once, said = device(), device(), []
    hand = WaitingHand(late, RATE_HZ, said.append)
    for tick in range(waited + 1):
        assert late.read(tick).position_m == (0.0, 0.0, 0.0)
        hand.poll(tick, tick == waited)
    assert said == ["the hand waits until everybody holds on", "everybody holds on: the hand begins"]
    assert hand.ticks == waited
    samples = [late.read(waited + tick) for tick in range(400)]
    assert samples == [at_once.read(tick) for tick in range(400)]
    assert max(sample.position_m[2] for sample in samples) > 0.01
    assert {sample.buttons for sample in samples} == {0, 2}


def test_a_hand_that_waits_holds_on() -> None:
    """It yields to a force by its stiffness, as a hand at rest."""
    waiting = device()
    WaitingHand(waiting, RATE_HZ, print)
    for tick in range(2000):
        waiting.read(tick)
        waiting.write(PUSHED_N)
    assert waiting.read(2000).position_m[0] == pytest.approx(-PUSHED_N[0] / 300.0, rel=1e-3)
    waiting.close()
    waiting.open(RATE_HZ)
    assert waiting.read(200).position_m[0] > 0.001, "opened anew it begins at once"


def test_a_session_that_waits_in_vain_ends() -> None:
    assert WaitingHand(device(), RATE_HZ, print).ticks == MOST_WAIT_S * RATE_HZ
    assert WaitingHand(None, RATE_HZ, print).ticks == 0


@pytest.mark.parametrize(
    ("mark", "everybody"),
    [
        (Mark(1, 1, EVERYBODY, 7), True),
        (Mark(1, 1, EVERYBODY, 7, seat=1, theirs=1), False),
        (Mark(1, 1, "the task is reached", 7), False),
    ],
)
def test_the_room_says_that_everybody_is_there_and_nobody_in_it_can(mark: Mark, everybody: bool) -> None:
    markers = OwnMarkers()
    markers.receive(mark, 0)
    assert markers.everybody is everybody
