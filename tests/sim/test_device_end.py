"""The device end in whole sessions: calm beyond what the device carries, untouched within, let go where the law oscillates."""

import tomllib
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import dist
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from cogrip.client.hand.velocity import largest_impedance
from cogrip.devices.device import Device, DeviceError, Sample
from cogrip.devices.for_user import make_for
from cogrip.devices.registry import is_input_only, make, stand_ins
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.sim import laboratory
from cogrip.sim.laboratory import Laboratory

from tests.extent import every, long
from tests.sim.session_measures import account_of, by_tick

CONFIGS = Path(__file__).parents[2] / "configs"
RATE_HZ = 1024
TAKEN_HOLD = 400  # ticks, in which the force is ramped in
HELD = {"hand": "reach&amplitude_m=0.012"}, {"hand": "hold"}
APART = {"hand": "reach&amplitude_m=0.04"}, {"hand": "reach&amplitude_m=0.03&delay_s=0.25"}


@dataclass
class Felt:
    """One person's forces, shape (ticks, axes), and how their device port ended."""

    forces: np.ndarray[Any, np.dtype[np.float64]]
    laboratory: Laboratory
    number: int

    @property
    def sign_changes_hz(self) -> float:
        force = self.forces[TAKEN_HOLD:, 0]
        signs = np.sign(force[np.abs(force) > 0.02])
        return float(np.count_nonzero(np.diff(signs))) / (len(force) / RATE_HZ)

    @property
    def largest_step_n(self) -> float:
        return max(map(dist, self.forces[:-1], self.forces[1:]))

    @property
    def core(self) -> Any:
        return self.laboratory.people[self.number].core

    @property
    def account(self) -> Any:
        return account_of(self.laboratory, self.number)


def felt(settings: Settings) -> list[Felt]:
    laboratory = Laboratory(settings)
    forces = np.array(by_tick(laboratory, lambda now: [person.core.force_n for person in now.people]))
    return [Felt(forces[:, number], laboratory, number) for number in range(len(laboratory.people))]


def room(seconds: float = 4.0, users: Sequence[dict[str, Any]] = HELD, device: str = "", **sections: Any) -> Settings:
    people = [{"name": f"person {n}", **({"device": device} if device else {}), **user} for n, user in enumerate(users)]
    return resolve(
        {"seconds": seconds, "link": {"delay_ms": 20.0}, "playout": {"frames": 1}, "users": people, **sections}
    )


def assert_calm(one: Felt) -> None:
    assert one.sign_changes_hz < 30.0
    assert one.largest_step_n < 1.0
    device = one.account.device
    assert not device.oscillates
    assert device.margin_j >= 0.0
    assert one.core.safety.state == "live"
    assert np.abs(one.forces).max() > 0.1, "a force is felt"


STAND_INS = sorted({address for addresses in stand_ins().values() for address in addresses if ":" in address})
# nobody moves the others
DEVICES = [each for each in STAND_INS if not each.startswith("replay") and not is_input_only(each)]


@pytest.mark.sample(1)
@pytest.mark.parametrize(("impedance", "axes"), every(3, product((50.0, 100.0), (1, 3))))
def test_an_impedance_far_beyond_what_the_device_carries_is_calm(impedance: float, axes: int) -> None:
    """Without the port, at 1 axis: +-8.5 N, 140 changes of sign a second, steps of 16 and 17 N."""
    for one in felt(room(1.8, users=APART, coupling={"impedance_nspm": impedance}, object={"axes": axes})):
        assert_calm(one)
        assert one.core.port.carried.nspm == largest_impedance(one.core.capability, 1.0 / RATE_HZ).impedance_nspm


@pytest.mark.sample(1)
@pytest.mark.parametrize(("device", "impedance"), every(21, product(DEVICES, (50.0, 100.0))))
def test_ten_times_the_stiffness_and_any_impedance_is_calm_on_every_device(device: str, impedance: float) -> None:
    stiffness = 10.0 * min(2000.0, make(device).capability.stiffness_npm)
    for one in felt(room(1.5, device=device, coupling={"impedance_nspm": impedance, "stiffness_npm": stiffness})):
        assert_calm(one)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("axes", [3, 6])
def test_every_device_plays_in_every_room_that_it_has_axes_for(device: str, axes: int) -> None:
    try:
        make(device, axes=axes)
    except DeviceError:
        pytest.skip(f"{device} has no {axes} axes")
    scene = {"kind": "scene", "file": str(CONFIGS / "scenes" / "valve.xml")} if axes == 6 else {}
    people = felt(room(0.3, device=device, object={"axes": axes, **scene}))
    for one in people:
        assert one.core.safety.state == "live", one.core.safety.reason


class Unlike:
    """A device that is not as its record says: its samples are `late` ticks older, and the record claims something else."""

    def __init__(self, device: Device, late: int, **claims: Any) -> None:
        self.device = device
        self.capability = replace(device.capability, **claims)
        self._samples: deque[Sample | None] = deque(maxlen=late + 1)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)

    def read(self, tick: int) -> Sample | None:
        self._samples.append(self.device.read(tick))
        return self._samples[0]


@pytest.fixture
def unlike(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    def use(late: int, **claims: Any) -> None:
        monkeypatch.setattr(laboratory, "make_for", lambda user, axes: Unlike(make_for(user, axes), late, **claims))

    return use


@pytest.mark.parametrize(
    ("late", "impedance", "mass_kg"),
    every(5, [(2, 50.0, 0.1), (4, 20.0, 0.1), (4, 50.0, 0.1), (2, 20.0, 0.02), (2, 20.0, 0.03)]),
)
def test_what_the_record_does_not_say_is_found_out(
    unlike: Callable[..., None], late: int, impedance: float, mass_kg: float
) -> None:
    """With older samples or a lighter handle than recorded, the impedance is reduced in a few turns.

    Without, these sessions swing by +-8.5 N.
    """
    unlike(late, apparent_mass_kg=0.1, damping_nspm=50.0)
    hands = [{**hand, "device_mass_kg": mass_kg} for hand in APART]
    people = felt(room(2.0, users=hands, coupling={"impedance_nspm": impedance}))
    for one in people:
        assert_calm(one)
    assert any(one.core.port.carried.nspm < 0.9 * impedance for one in people)


OFTEN = {
    "demo": CONFIGS / "demo.toml",
    "wall of 20000 N/m": room(object={"kind": "wall"}, coupling={"stiffness_npm": 2e4}),
    "virtual coupling": room(coupling={"kind": "coupling"}, link={"delay_ms": 0.0}, playout={"frames": 0}),
    "a Pantograph": room(device="emulated:pantograph", coupling={"impedance_nspm": 1.9}),
}
SELDOM = {
    **{name: CONFIGS / f"{name}.toml" for name in ("lan", "wan", "three-users", "five-users")},
    **{name: room(link={"profile": name}, playout={"frames": "auto"}) for name in ("wifi", "lte")},
    "3 axes": room(object={"axes": 3}),
    "faces of 20000 N/m": room(
        users=({"hand": "reach"}, {"hand": "hold", "side": "right"}),
        object={"kind": "faces"},
        coupling={"stiffness_npm": 2e4},
    ),
    "tremor": room(users=({"hand": "tremor"}, {"hand": "hold"})),
    "a Phantom": room(device="emulated:vintage", coupling={"impedance_nspm": 7.9}),
}


@pytest.mark.sample(1)
@pytest.mark.parametrize("within", [*OFTEN.values(), *map(long, SELDOM.values())], ids=[*OFTEN, *SELDOM])
def test_within_what_devices_carry_the_port_is_idle(within: Settings | Path) -> None:
    """The port changes no force by a bit: nothing controlled, nothing deflected, the reserve hardly touched."""
    settings = within if isinstance(within, Settings) else resolve(tomllib.loads(within.read_text()))
    for one in felt(structs.replace(settings, seconds=1.2)):
        port = one.core.port
        assert one.account.device.controlled == 0.0
        assert port.carried.nspm == largest_impedance(one.core.capability, one.core.seat.rates.tick_s).impedance_nspm
        assert not port.oscillates
        assert one.account.device.leak_j < 0.1 * port.reserve_j


@pytest.mark.parametrize(("stiffness", "ends"), [long(500.0, "fault"), (1000.0, "fault"), long(2000.0, "live")])
def test_a_law_that_oscillates_over_the_network_is_let_go_and_ends_in_a_fault_if_it_goes_on(
    stiffness: float, ends: str
) -> None:
    """Virtual coupling at 20 ms in each direction (theory section 6) is unstable with any port, and ends in a fault."""
    coupling = {"kind": "coupling", "stiffness_npm": stiffness}
    people = felt(room(8.0 if ends == "fault" else 4.0, users=APART, coupling=coupling))
    reasons = [one.core.safety.reason for one in people]
    assert any(one.account.device.let_go for one in people)
    assert any(one.core.safety.state == ends for one in people), reasons
    for one in people:
        if one.core.safety.state == "fault":
            assert "set coupling.stiffness_npm lower" in one.core.safety.reason
            assert one.laboratory.incident or not one.forces[-1].any()
        assert one.core.port.balance_j >= -one.core.port.reserve_j
        assert one.largest_step_n < 1.0


@pytest.mark.parametrize("damping", [0.0, 2.0, 10.0])
def test_virtual_coupling_keeps_its_spring_whatever_its_damping(damping: float) -> None:
    """K l T < b holds with what the device carries, not with the B that is asked for."""
    coupling = {"kind": "coupling", "stiffness_npm": 1000.0, "damping_nspm": damping}
    thing, link = {"kind": "wall"}, {"delay_ms": 0.0}
    [one] = felt(room(1.0, users=({"hand": "hold"},), object=thing, coupling=coupling, link=link))
    assert not one.core.coupling.reduced


@pytest.mark.long
def test_warm_motors_are_no_oscillation() -> None:
    """Run `configs/lan.toml` for 60 s: hands pull with more than motors give for long."""
    people = felt(resolve(tomllib.loads((CONFIGS / "lan.toml").read_text())))
    assert any(one.core.safety.counts.get("thermally limited") for one in people)
    for one in people:
        assert one.account.device.let_go == 0
        assert one.core.safety.state == "live"


def test_a_hand_that_overpowers_the_motors_gives_the_line_no_more_than_it_gave() -> None:
    """A hand of 4 Hz and 50 mm takes more than 8.5 N for most of the time."""
    people = felt(room(1.5, users=({"hand": "sine&amplitude_m=0.05&frequency_hz=4"}, {"hand": "hold"})))
    for one in people:
        assert one.core.port.balance_j >= -one.core.port.reserve_j
    assert people[0].core.safety.counts["force clipped"] > 0


@pytest.mark.sample(1)
@pytest.mark.parametrize(("kind", "force_n"), every(5, product(("cube", "wall"), (1.0, 1.5, 2.0))))
def test_a_hand_that_pushes_from_the_start_is_not_thrown_back(kind: str, force_n: float) -> None:
    """The line takes what the hand gives while its force is ramped in, and 50 mJ; before, 2 N loaded it with 2.8 J."""
    hands = ({"hand": f"push&force_n={force_n}"}, {"hand": "hold"})
    for one in felt(room(2.0, users=hands, object={"kind": kind})):
        assert one.core.safety.state == "live"
        assert one.account.device.margin_j > 0.0
        assert abs(one.core.position_m[0]) < 0.03


@pytest.mark.long
def test_whoever_leaves_a_push_alone_is_followed_by_no_energy() -> None:
    """The partner leaves while the other pushes 1.6 N: the hand runs off, the device gives nothing that did not come in."""
    laboratory = Laboratory(room(3.0, users=({"hand": "push&force_n=1.6"}, {"hand": "hold"})))
    laboratory.run(None, lambda lab: lab.leave(1) if lab.seconds >= 1.5 and not lab.people[1].going else None)
    margin_j = laboratory.people[0].core.port.account().margin_j
    assert margin_j > 0.0


SWING = "sine&amplitude_m=0.0143&frequency_hz=1.356&direction=-1&offset_m=0.03"
TREMBLE = "tremor&amplitude_m=0&tremor_m=0.0008&direction=-1"


@pytest.mark.sample(4)
@pytest.mark.parametrize("delay_ms", [0.0, 0.1, 1.0, 8.0])
@pytest.mark.parametrize("hand", [SWING, TREMBLE])
def test_a_hand_that_moves_freely_is_not_let_go(hand: str, delay_ms: float) -> None:
    """Nothing is touched, and nothing rings: the port keeps the impedance of the record.

    The force of a hand that trembles steps at each frame, and ramps back: that is no oscillation.
    """
    device = "sim:phantom?resolution_m=0&friction_n=0"
    settings = resolve({
        "users": [{"name": "anna", "device": device, "hand": hand, "side": "left"}], "object": {"kind": "faces"},
        "link": {"delay_ms": delay_ms}, "playout": {"frames": "auto"}, "seconds": 4.0,
    })  # fmt: skip
    running = Laboratory(settings)
    running.run()
    core = running.people[0].core
    assert core.safety.state == "live"
    assert "released: oscillation" not in core.safety.counts
    assert core.port.carried.nspm == core.port.carried.record_nspm
