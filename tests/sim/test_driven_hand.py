"""Devices that drive the hand: whatever ends the force within a session says what finds the cause."""

import pytest

from tests.devices.faulty_device import SIGN, SWAP, FaultyDevice
from tests.sim.session_measures import laboratory_of

LOOSE, STROKES = "hold&hand_stiffness_npm=60&hand_damping_nspm=1", "reach&amplitude_m=0.03"
PARTNER = {
    "name": "ben",
    "device": "sim:phantom",
    "hand": "sine&amplitude_m=0.02&frequency_hz=0.7&hand_stiffness_npm=200",
}


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("kind", "hand", "fault", "words"),
    [
        ("cube", LOOSE, SIGN, "over-speed: "), ("cube", LOOSE, SWAP, "over-speed: "),
        ("wall", STROKES, SIGN, "the force sits at its limit of 5 N"),
    ],
)  # fmt: skip
def test_a_fault_names_the_command_that_finds_a_wrong_sign(kind: str, hand: str, fault: str, words: str) -> None:
    """Nobody is told only to push less, or to slow down, who did neither."""
    laboratory = laboratory_of(
        seconds=6.0, object={"kind": kind, "axes": 3}, link={"delay_ms": 10.0}, coupling={"impedance_nspm": 3.0},
        users=[{"name": "anna", "device": "emulated:woodenhaptics", "hand": hand}, PARTNER],
    )  # fmt: skip
    person = laboratory.people[0]
    person.device = FaultyDevice(person.device, fault)
    laboratory.run(None, None, lambda: person.core.in_fault)
    assert person.core.in_fault
    reason = person.core.seated.safety.reason
    assert reason.startswith(words)
    assert "`cogrip devices conform` tells a wrong sign or gain" in reason
