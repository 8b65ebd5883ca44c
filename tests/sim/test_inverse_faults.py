"""Whatever goes wrong between a client and an Inverse3's service: sessions in virtual time, as in `test_device_faults`."""

from functools import cache
from math import hypot

import pytest

from cogrip.devices.emulated.inverse_service import IDLE_NS
from cogrip.protocol.settings import resolve
from cogrip.sim.session.laboratory import Laboratory

from tests.extent import long
from tests.sim.test_device_faults import (
    AFTER_S,
    AT_ONCE_S,
    BEGIN_S,
    HANDS,
    KICK_N,
    RATE_HZ,
    REARMED_S,
    Course,
    firmware,
    passive,
    run,
)  # fmt: skip

WIRE = "emulated:inverse3"
BEGIN = round(BEGIN_S * RATE_HZ)


def session(seconds: float) -> Laboratory:
    users = [{"name": name, "device": WIRE, "hand": hand} for name, hand in zip(("anna", "ben"), HANDS, strict=True)]
    coupling = {"impedance_nspm": 4.0, "stiffness_npm": 300.0, "damping_nspm": 2.0}
    return Laboratory(
        resolve(
            {
                "seconds": seconds,
                "coupling": coupling,
                "link": {"delay_ms": 7},
                "playout": {"frames": 1},
                "users": users,
            }
        )
    )


@cache
def undisturbed() -> Course:
    return run(session(BEGIN_S + 2.0 * AFTER_S), lambda tick: None)


@pytest.mark.sample(1)
@pytest.mark.parametrize("verb", ["unplug", *map(long, ("silence", "garbage", "short")), "slow", long("model"), "jump"])
def test_the_force_ends_within_50_ms_and_the_other_goes_on(verb: str) -> None:
    laboratory = session(BEGIN_S + AFTER_S)
    anna = laboratory.people[0]
    course = run(laboratory, lambda tick: firmware(anna).fault(verb) if tick == BEGIN else None)
    assert course.force[BEGIN - 1][0] > 0.3, "there was a force to end"
    assert anna.core.safety.state == "fault"
    assert not any(force for force, _ in course.force[BEGIN + round(AT_ONCE_S * RATE_HZ) :])
    assert course.kick_n(undisturbed(), 0, BEGIN) < KICK_N
    assert course.kick_n(undisturbed(), 1, BEGIN) < KICK_N
    assert all(state == "live" for _, state in course.state[BEGIN:]), "the other goes on"
    assert passive(laboratory)


@pytest.mark.long
def test_a_killed_service_is_told_by_name_and_re_armed_when_it_is_back() -> None:
    laboratory = session(BEGIN_S + 0.6 + REARMED_S)
    anna = laboratory.people[0]
    again = round((BEGIN_S + 0.6) * RATE_HZ)
    refusals: list[str] = []
    reasons: list[str] = []

    def each(tick: int) -> None:
        if tick == BEGIN:
            firmware(anna).fault("unplug")
        elif tick == BEGIN + 100:
            reasons.append(anna.core.safety.reason)
            refusals.append(anna.supervised.rearm())
        elif tick == again:
            firmware(anna).mend()
            refusals.append(anna.supervised.rearm())

    course = run(laboratory, each)
    assert reasons == ["device: emulated:inverse3: lost: it was unplugged; plug it in again, then re-arm"]
    assert "plug it in" in refusals[0]
    assert refusals[1] == ""
    assert anna.core.safety.state == "live"
    assert course.peak(0, again + RATE_HZ // 2) > 0.2, "force flows again"
    assert passive(laboratory)


@pytest.mark.sample(1)
@pytest.mark.parametrize("verb", ["stale", "merge"])
def test_what_the_driver_copes_with_is_counted_and_the_session_goes_on(verb: str) -> None:
    laboratory = session(BEGIN_S + AFTER_S)
    anna = laboratory.people[0]
    run(laboratory, lambda tick: firmware(anna).fault(verb, 0.004) if tick == BEGIN else None)
    assert anna.core.safety.state == "live"
    assert passive(laboratory)


@pytest.mark.long
def test_a_service_that_hears_nothing_lets_go_by_itself() -> None:
    """No client reaches it then: the service's own idling ends the force. After how long, its pages do not say."""
    laboratory = session(BEGIN_S + 0.2 + 1e-9 * IDLE_NS)
    anna = laboratory.people[0]
    course = run(laboratory, lambda tick: firmware(anna).fault("deaf") if tick == BEGIN else None)
    assert anna.core.safety.state == "fault"
    assert course.force[-1][0] == 0.0
    assert hypot(*course.force[BEGIN - 1]) > 0.3
