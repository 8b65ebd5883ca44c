"""Devices whose motors push the wrong way, in whole sessions of virtual time; and hands that only look like one."""

from itertools import product

import pytest

from cogrip.protocol.settings import resolve
from cogrip.sim.session.laboratory import Laboratory

from tests.devices.faulty_device import POSITION_SIGN, SIGN, SWAP, FaultyDevice
from tests.extent import every

RELEASED = "released: the device ran with its force"
SEVERAL_N = 0.2  # of the peak force


def session(
    device: str, hand: str, fault: str = "", *, kind: str = "wave", delay_ms: float = 20.0, seconds: float = 2.0,
    b: float = 20.0, link: dict[str, float] | None = None, axes: int = 3,
) -> tuple[Laboratory, float]:  # fmt: skip
    """Run a session whose anna holds this device; return it, and the largest force that her motors were asked for [N]."""
    ben = f"reach&amplitude_m=0.03&delay_s=0.25&direction={'1,0.5,0.7' if axes > 2 else '1,0.5'}"
    users = [{"name": "anna", "device": device, "hand": hand}, {"name": "ben", "hand": ben}]
    coupling = {"kind": kind, **({"impedance_nspm": b} if kind == "wave" else {})}
    settings = {
        "seconds": seconds,
        "object": {"axes": axes},
        "coupling": coupling,
        "link": {"delay_ms": delay_ms, **(link or {})},
    }
    laboratory = Laboratory(resolve({**settings, "users": users}))
    anna, most = laboratory.people[0], 0.0
    anna.device = FaultyDevice(anna.device, fault)

    def watch(laboratory: Laboratory) -> None:
        nonlocal most
        most = max(most, sum(part * part for part in anna.core.force_n) ** 0.5)

    laboratory.run(watch)
    return laboratory, most


FOUND = (
    ("wave", 20.0, "hold", SIGN), ("wave", 20.0, "hold", POSITION_SIGN),
    ("wave", 20.0, "reach&amplitude_m=0.03&direction=0.6,0.5,-0.6&stroke_s=1.2", SIGN),
    ("wave", 20.0, "reach&amplitude_m=0.03&direction=0.6,0.5,-0.6&stroke_s=1.2", POSITION_SIGN),
    ("wave", 10.0, "hold&hand_stiffness_npm=60&hand_damping_nspm=1", SIGN), ("wave", 10.0, "reach&amplitude_m=0.04", SIGN),
    ("coupling", 0.0, "hold", SIGN), ("coupling", 0.0, "hold", SWAP), ("coupling", 0.0, "reach&amplitude_m=0.04", SIGN),
    ("tdpa", 0.0, "hold", SIGN), ("tdpa", 0.0, "reach&amplitude_m=0.04", SIGN),
)  # fmt: skip


@pytest.mark.parametrize(("kind", "b", "hand", "fault"), FOUND)
def test_a_device_that_runs_with_its_force_is_let_go_far_below_its_peak(
    kind: str, b: float, hand: str, fault: str
) -> None:
    """Before, at 8.5 N after 2 s, with the advice to push less."""
    laboratory, most = session("sim:phantom", hand, fault, kind=kind, b=b)
    anna, ben = laboratory.people
    assert anna.core.seated is not None
    trial, safety = anna.core.seated.trial, anna.core.safety
    assert most < SEVERAL_N * 8.5
    assert min(trial.ratios) < -0.45
    assert 0 not in trial.proved
    assert ben.core.safety.state == "live"
    if safety.state == "fault":
        assert safety.reason == trial.fault
        assert "the device runs with its force along x" in safety.reason
        assert ("swapped" if fault == SWAP else "wrong") in safety.reason
        assert not any(anna.core.force_n)
    else:
        assert trial.most_n == pytest.approx(0.12 * 8.5), "held back until it is known"


def test_the_fault_names_the_axis_and_the_cause() -> None:
    laboratory, _ = session("sim:phantom", "reach&amplitude_m=0.03&direction=0.6,0.5,-0.6&stroke_s=1.2", SIGN)
    reason = laboratory.people[0].core.safety.reason
    assert reason.startswith("the device runs with its force along x, so the sign of its motor or of its encoder")


HANDS = (
    "reach&amplitude_m=0.04", "hold", "hold&hand_stiffness_npm=0&hand_damping_nspm=0", "push&force_n=2&start_s=0.5",
    "reach&amplitude_m=0.04&stroke_s=0.25&rest_s=0.3&direction=1,0.3", "tremor&tremor_m=0.001&amplitude_m=0.03",
    "reach&amplitude_m=0.05&stroke_s=0.5&hand_stiffness_npm=1500&hand_damping_nspm=15", "sine&amplitude_m=0.01&frequency_hz=3",
)  # fmt: skip
ARMS = (("sim:phantom", 20.0), ("sim:phantom?mass_kg=0.15", 20.0), ("sim:ideal", 20.0), ("emulated:2diy", 2.0))
NETWORKS: tuple[tuple[float, dict[str, float]], ...] = (
    (0.0, {}),
    (20.0, {}),
    (150.0, {}),
    (300.0, {}),
    (20.0, {"loss": 0.05, "jitter_ms": 5.0}),
)


@pytest.mark.parametrize(("arm", "hand", "network"), every(8, product(ARMS, HANDS, NETWORKS)))
def test_no_hand_is_taken_for_a_motor(
    arm: tuple[str, float], hand: str, network: tuple[float, dict[str, float]]
) -> None:
    (device, b), (delay_ms, link) = arm, network
    axes = 2 if device.endswith("2diy") else 3
    laboratory, _ = session(device, hand, b=b, delay_ms=delay_ms, link=link, seconds=3.0, axes=axes)
    assert "runs with its force" not in laboratory.people[0].core.safety.reason


@pytest.mark.parametrize("kind", ["wave", "coupling", "tdpa"])
def test_a_hand_at_its_usual_pace_is_never_let_go_for_it(kind: str) -> None:
    laboratory, _ = session("sim:phantom", "reach&amplitude_m=0.04", kind=kind, seconds=4.0)
    assert [person.core.safety.counts[RELEASED] for person in laboratory.people] == [0, 0]


def test_a_quick_hand_is_let_go_once_and_taken_back_at_once() -> None:
    laboratory, _ = session("sim:phantom", "reach&amplitude_m=0.04&stroke_s=0.25&rest_s=0.3", seconds=4.0)
    anna = laboratory.people[0].core
    assert anna.safety.counts[RELEASED] == 1
    assert anna.seated is not None
    assert anna.seated.trial.proved == {0}
    assert anna.safety.state == "live"
