"""A client's copy of the object, and partners as its messages tell of them."""

from itertools import pairwise
from typing import Any

from cogrip.client.coupling.partner.partner_coupling import PartnerCoupling
from cogrip.devices.simulated.phantom import PhantomSettings, capability
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.messages import Intent, Partner, Stamp

TICK_S = 1.0 / 1024
COUPLING = {"kind": "partner", "stiffness_npm": 1000.0, "damping_nspm": 10.0}


def coupling_of(people: int = 2) -> PartnerCoupling:
    users = [{"name": f"p{each}"} for each in range(people)]
    settings = resolve({"coupling": COUPLING, "object": {"axes": 1, "mass_kg": 0.2}, "users": users})
    return PartnerCoupling(seat_settings(settings, 0))


def told(number: int, *intents: Intent) -> Partner:
    return Partner(1, number, (0.0,), (0.0,), intents, 0, Stamp(1))


def intent(seat: int, place_m: float, **changes: Any) -> Intent:
    return Intent(seat, changes.get("made_ns", 1), (place_m,), (0.0,), changes.get("stiffness_npm", 150.0), 0.0)


def test_a_partner_who_comes_far_from_the_copy_pulls_as_its_stiffness_grows() -> None:
    """Its model begins where the copy is: a spring of K to where it intends to be would be a step of force."""
    coupling = coupling_of()
    forces = [coupling.force((0.04,), (0.0,))[0]]
    coupling.end_frame()
    coupling.receive(told(0, intent(1, -0.04)))
    coupling.start_frame()
    for tick in range(1024):
        if tick % 8 == 0:
            coupling.receive(told(1 + tick // 8, intent(1, -0.04, made_ns=2 + tick)))
            coupling.end_frame()
            coupling.start_frame()
        coupling.applied_n = (forces[-1],)
        coupling.elapse((0.0,), (0.0,))
        forces.append(coupling.force((0.04,), (0.0,))[0])
    assert forces[-1] > 5.0
    assert max(abs(b - a) for a, b in pairwise(forces)) < 0.1


def test_the_stiffness_of_a_partner_who_comes_back_grows_as_that_of_one_who_comes() -> None:
    coupling = coupling_of()

    def frames(count: int, silent: bool = False) -> float:
        """Let frames pass. Return the largest step of the stiffness of the partner's model."""
        most, before = 0.0, 0.0
        for _ in range(count):
            coupling.end_frame()
            if not silent:
                coupling.receive(told(len(seen), intent(1, 0.0, made_ns=1 + len(seen))))
            seen.append(0)
            coupling.start_frame()
            for _ in range(8):
                coupling.elapse((0.0,), (0.0,))
                coupling.force((0.0,), (0.0,))
                now = coupling.partners[1].model.stiffness_npm
                most, before = max(most, now - before), now
        return most

    seen: list[int] = []
    came = frames(128)
    assert coupling.partners[1].model.stiffness_npm == 150.0
    frames(128, silent=True)
    assert coupling.partners[1].model.stiffness_npm == 0.0
    assert frames(128) <= came * (1.0 + 1e-9)
    assert coupling.partners[1].model.stiffness_npm == 150.0


def test_a_line_that_goes_on_knows_the_hand_as_the_one_before_did_and_another_device_anew() -> None:
    """A server that is started again, or a seat that is taken again, is no reason to take the hand for another."""
    record = capability(PhantomSettings(), 1)
    before, after, elsewhere = coupling_of(), coupling_of(), coupling_of()
    before.fit(record, 0.001)
    before.grip.stiffness_npm = 320.0
    for each in (after, elsewhere):
        each.go_on_from(before)
    after.fit(record, 0.001)
    elsewhere.fit(capability(PhantomSettings(mass_kg=0.2), 1), 0.001)
    assert (after.grip, after.intention, after.release) == (before.grip, before.intention, before.release)
    assert after.grip.stiffness_npm == 320.0
    assert elsewhere.grip.stiffness_npm == 150.0
