"""Three and five people hold one cube through 102 ms each way: how far what they feel is from no network."""

from typing import Any

import numpy as np
import pytest

from cogrip.analysis.feel.trace import Array
from cogrip.experiments.methods.case import run_session
from cogrip.experiments.methods.method import ideal_settings, session_settings

from tests.extent import long

SECONDS, FIRST_S = 4.0, 1.5
HANDS_NPM = (300.0, 150.0, 500.0, 250.0, 400.0)
SLOW_HZ = (0.13, 0.34, 0.21, 0.55, 0.42)


def settings_of(people: int, delay_ms: float) -> dict[str, Any]:
    """Return people who swing at their own pace, each with a hand of another stiffness."""
    return {
        "seconds": SECONDS, "coupling": {"stiffness_npm": 1000.0, "damping_nspm": 10.0, "impedance_nspm": 20.0},
        "object": {"axes": 1, "mass_kg": 0.2}, "link": {"delay_ms": delay_ms},
        "users": [
            {
                "name": f"p{number}", "device": "sim:ideal?mass_kg=0.1&damping_nspm=0.5",
                "hand": f"sine&amplitude_m={0.03 * (-1) ** number}&frequency_hz={SLOW_HZ[number]}&ramp_s=1"
                f"&hand_stiffness_npm={HANDS_NPM[number]}&hand_damping_nspm=5",
            }
            for number in range(people)
        ],
    }  # fmt: skip


def size_n(force_n: Array) -> float:
    return float(np.sqrt((force_n[round(FIRST_S * 1024) :] ** 2).mean()))


@pytest.mark.parametrize("people", [3, long(5)])
def test_many_people_feel_each_other_through_a_delay(people: int) -> None:
    wanted_n = run_session(ideal_settings(settings_of(people, 0.0), 1), SECONDS).trace.force_n

    def error(method: str) -> float:
        found = run_session(session_settings(settings_of(people, 101.6), method, "own", 1), SECONDS)
        assert not found.diverged
        return size_n(found.trace.force_n - wanted_n) / size_n(wanted_n)

    assert error("partner") <= 0.4
    assert error("partner") < 0.8 * error("wave")
