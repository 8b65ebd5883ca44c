"""The parameters of a session's linear model, read from settings.

Left out as not linear: friction, encoder steps, clamps, ramps, jitter and loss. Assumed: a face or a wall stays in touch.
Hands are left out unless asked for, as in P (F_h is an input of its eq. 9, 10).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Literal, NamedTuple

import numpy as np

from cogrip.analysis.linear.state_space import Complex
from cogrip.client.hand.velocity import MEMORY, memory_for
from cogrip.client.safety.rendered_damper import seat_on
from cogrip.devices.device import Capability, Device
from cogrip.devices.for_user import address_of, make_for
from cogrip.devices.settings import parse_address
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.protocol.settings.coupling import Coupling
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS, Kind
from cogrip.protocol.settings.delays import OneWayDelay, line_delay, one_way
from cogrip.protocol.settings.line_tuning import filter_lag_s
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.room import seat_axes, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings, User
from cogrip.protocol.settings.types import Decimator, Encoder, ServerStep

Form = Literal["passive", "paper", "coupling"]
MOST_FRAMES = 256


class FormRow(NamedTuple):
    """One form of linear model, and the settings that ask for it: P's has P's filter and encoder.

    title, short  its names in figures, where it stands beside the others, and in a narrow place
    lagged        the server's step uses each spring's force of the step before, and sees its stretch before the hand moves
    """

    title: str
    short: str
    kind: Kind
    lagged: bool
    step: ServerStep = "passive"
    decimator: Decimator | None = None
    encoder: Encoder | None = None

    @property
    def waves(self) -> bool:
        """True where the lines of the model carry waves, else positions and forces."""
        return COUPLING_KINDS[self.kind].waves

    @property
    def passive(self) -> bool:
        """True where the server makes no energy of what comes through its lines."""
        return COUPLING_KINDS[self.kind].passive and self.step == "passive"

    @property
    def damper_key(self) -> str:
        """Key of [coupling], and field of `LinearPerson`, of the damper that a device renders."""
        return COUPLING_KINDS[self.kind].damper.key


FORMS: dict[Form, FormRow] = {
    "passive": FormRow("cogrip's passive scheme", "cogrip", "wave", False),
    "paper": FormRow("the paper's scheme", "the paper's scheme", "wave", True, "paper", "lowpass", "velocity"),
    "coupling": FormRow("virtual coupling", "virtual coupling", "coupling", False),
}
"""Row of each form. passive: waves and theory section 3's server step; paper: P eq. 12-18; coupling: theory section 5."""


class ModelError(ValueError):
    """A session without a linear model; the text says what to ask instead."""


@dataclass(frozen=True, slots=True)
class LinearPerson:
    """One user: device, hand, coupling, and the delay of the line in each direction.

    device_mass_kg, device_damping_nspm   m_HD, b_HD
    hand_stiffness_npm, hand_damping_nspm K_h, B_h of the hand that holds it; 0: no hand
    estimated                             the force law reads the client's velocity estimate, not the exact velocity
    impedance_nspm                        b
    stiffness_npm, damping_nspm           K, B of the spring to the object
    up, down                              delay of the line in each direction
    rates                                 of this user's device, and the room's network
    memory                                of that estimate, see `MotionObserver`
    mass_known                            factor of the record's mass, by which that estimate goes, on the device's; inf: it
                                          knows positions alone
    latency_ticks                         age of a sample when it is read
    filter_lag_s                          S of the filter on each wave; 0: none
    """

    name: str
    device_mass_kg: float
    device_damping_nspm: float
    impedance_nspm: float
    stiffness_npm: float
    damping_nspm: float
    decimator: str
    lowpass_rad_s: float
    encoder: str
    up: OneWayDelay
    down: OneWayDelay
    rates: Rates
    hand_stiffness_npm: float = 0.0
    hand_damping_nspm: float = 0.0
    estimated: bool = False
    memory: float = MEMORY
    latency_ticks: int = 0
    filter_lag_s: float = 0.0
    mass_known: float = 1.0

    @property
    def observes(self) -> bool:
        """True where the velocity estimate goes by the force as well: not where the waves are made of it."""
        return self.estimated and isfinite(self.mass_known) and self.encoder != "velocity"

    @property
    def assumed_mass_kg(self) -> float:
        """Mass of the device by its record."""
        return self.mass_known * self.device_mass_kg if self.observes else inf

    @property
    def filter_kept(self) -> float:
        """Fraction of the filter's last output in the next one, S / (S + T_n)."""
        return self.filter_lag_s / (self.filter_lag_s + self.rates.frame_s)

    def filtered(self, z: Complex) -> Complex:
        """Return the response of the filter to frames."""
        kept = self.filter_kept
        return np.asarray((1.0 - kept) / (1.0 - kept / z), dtype=np.complex128)

    @property
    def down_frames(self) -> int:
        """Whole frames in the downlink."""
        return self.down.ticks // self.rates.ticks_per_frame

    @property
    def up_frames(self) -> int:
        """Whole frames in the uplink, with the rest of the downlink: together they are the whole frames of both."""
        return (self.up.ticks + self.down.ticks) // self.rates.ticks_per_frame - self.down_frames

    @property
    def split_ticks(self) -> int:
        """Ticks of both directions beyond whole frames: a frame that is sent has so many from before the newest wave."""
        return (self.up.ticks + self.down.ticks) % self.rates.ticks_per_frame


@dataclass(frozen=True, slots=True)
class LinearSession:
    """The linear part of a session. `midpoint`: the passive step is theory 3.3's (gripped), else 3.4's (pushed).

    frame_s: T_n, everybody's; device ticks are each person's own. local: each client renders its own contact
    """

    form: Form
    frame_s: float
    people: tuple[LinearPerson, ...]
    fixed: bool
    midpoint: bool
    object_mass_kg: float
    object_damping_nspm: float
    local: bool = False

    @property
    def traits(self) -> FormRow:
        """Properties of its form."""
        return FORMS[self.form]

    @property
    def stiffness_npm(self) -> tuple[float, ...]:
        return tuple(person.stiffness_npm for person in self.people)


def form_of(coupling: Coupling) -> Form:
    """Return the form of a scheme's linear model. Raises ModelError for one that is not linear."""
    if coupling.traits.linear is None:
        limits = "an energy gate" if coupling.traits.gated else "a passivity controller"
        raise ModelError(
            f'coupling.kind = "{coupling.kind}": {limits} is not '
            "linear, so there is no model of it; "
            + (
                "`cogrip feel` and `stability radius` have the loop gain of its hands, "
                if coupling.traits.gated
                else ""
            )
            + "`cogrip lab` and `cogrip sweep` run whole sessions of it"
            + (" (coupling.compensate has no effect there)" if coupling.compensate else "")
        )
    return "paper" if coupling.server_step == "paper" else coupling.traits.linear


def form_overrides(form: Form) -> dict[str, str]:
    """Return the settings that ask for a form."""
    row = FORMS[form]
    keys = {"kind": row.kind, "server_step": row.step, "decimator": row.decimator, "encoder": row.encoder}
    return {f"coupling.{key}": value for key, value in keys.items() if value is not None}


def linear_session(
    settings: Settings, *, delay_frames: float | None = None, hands: bool = False, estimated: bool = True
) -> LinearSession:
    """Return the linear part of `settings`.

    delay_frames: this delay in each direction [network frames] for everyone, in place of link and playout
    hands: the simulated hands hold on with their K_h, B_h (default: free devices, as in P and theory section 6)
    estimated: devices that give no velocity use the client's estimate; False: exact velocities, idealised as in P
    Raises ModelError for a scheme that does not fit the object; DeviceError for an impossible device.
    """
    people = []
    for number, user in enumerate(settings.users):
        device = make_for(user, seat_axes(settings, user))
        person = _person(seat_settings(settings, number), device.capability, delay_frames)
        people.append(_simulated(person, user, device, hands, estimated))
    return _session(seat_settings(settings, 0), people)


def seats_on_devices(settings: Settings) -> list[tuple[SeatSettings, Capability]]:
    """Return each seat as its client begins it on its device, and the record of that device. Raises DeviceError."""
    records = [make_for(user, seat_axes(settings, user)).capability for user in settings.users]
    return [(seat_on(seat_settings(settings, number), record), record) for number, record in enumerate(records)]


def seat_session(seat: SeatSettings, capability: Capability) -> LinearSession:
    """Return the model of one seat alone, with its device: for a client, which knows nobody else's settings.

    The device's damping is taken as 0, its velocity as estimated where it gives none. Raises ModelError.
    """
    return _session(seat, [_person(seat, capability, None)])


def _person(seat: SeatSettings, capability: Capability, delay_frames: float | None) -> LinearPerson:
    up, down = line_delays(seat, delay_frames)
    seat = seat_on(seat, capability)
    coupling = seat.coupling
    return LinearPerson(
        name=seat.user,
        device_mass_kg=capability.apparent_mass_kg,
        device_damping_nspm=0.0,
        impedance_nspm=coupling.impedance_nspm,
        stiffness_npm=seat.rendered_npm,
        damping_nspm=coupling.damping_nspm,
        decimator=coupling.decimator,
        lowpass_rad_s=coupling.lowpass_rad_s,
        encoder=coupling.encoder,
        up=up,
        down=down,
        rates=seat.rates,
        estimated=not capability.gives_velocity,
        memory=memory_for(capability, seat.rates.tick_s),
        latency_ticks=capability.latency_ticks,
        filter_lag_s=filter_lag_s(seat.line.wave_filter_hz) if coupling.traits.felt_through_waves else 0.0,
    )


def _session(seat: SeatSettings, people: Sequence[LinearPerson]) -> LinearSession:
    form, kind = form_of(seat.coupling), seat.object.kind
    if not kind_of(kind).plain:
        raise ModelError(
            f'object.kind = "{kind}" has no linear model: its world alone says how it moves; try it with `cogrip lab`'
        )
    local = seat.coupling.traits.local
    traits = kind_of(kind)
    if traits.one_sided and not traits.fixed and not FORMS[form].passive and not local:
        raise ModelError(
            f'scheme "{form}" does not fit object.kind = "{kind}": there contact comes and goes, and for a step that is '
            "not passive a model of lasting contact would promise too much; "
            'use object.kind = "cube" or "wall", or scheme "passive"'
        )
    return LinearSession(
        form=form,
        frame_s=seat.rates.frame_s,
        people=tuple(people),
        fixed=local or traits.fixed,  # to a client its own contact is hardest where the face behind it stands still
        midpoint=traits.held,
        object_mass_kg=seat.object.mass_kg,
        object_damping_nspm=seat.object.damping_nspm,
        local=local,
    )


def _simulated(person: LinearPerson, user: User, device: Device, hands: bool, estimated: bool) -> LinearPerson:
    """Return the person with the parameters of a simulated device and its hand, which only the settings hold."""
    hand = device.hand if hands and isinstance(device, SimulatedDevice) else None
    return replace(
        person,
        device_damping_nspm=_damping(user),
        hand_stiffness_npm=hand.stiffness_npm if hand else 0.0,
        hand_damping_nspm=hand.damping_nspm if hand else 0.0,
        estimated=estimated and person.estimated,
    )


def line_delays(seat: SeatSettings, delay_frames: float | None = None) -> tuple[OneWayDelay, OneWayDelay]:
    """Return the delays up and down; virtual coupling has no playout. Raises ModelError for a delay below 0."""
    if seat.coupling.traits.local:
        return one_way(0.0, 0, seat.rates), one_way(0.0, 0, seat.rates)
    if delay_frames is not None:
        if not 0.0 <= delay_frames <= MOST_FRAMES:
            raise ModelError(f"delay of {delay_frames:g} frames each way is out of 0 to {MOST_FRAMES}")
        delay = one_way(delay_frames * seat.rates.frame_s * 1e3, 0, seat.rates)
        return delay, delay
    if seat.coupling.traits.felt_through_waves:
        return line_delay(seat.playout, seat.up, seat.rates), line_delay(seat.playout, seat.down, seat.rates)
    return one_way(seat.up.delay_ms, 0, seat.rates), one_way(seat.down.delay_ms, 0, seat.rates)


def rounding_notes(session: LinearSession) -> tuple[str, ...]:
    """Return a sentence for each delay that was rounded to whole ticks or frames."""
    directions = [(direction, person.rates) for person in session.people for direction in (person.up, person.down)]
    return tuple(
        _rounding(direction, rates)
        for direction, rates in dict.fromkeys(directions)
        if not direction.whole or direction.frame_wait_ticks
    )


def _rounding(direction: OneWayDelay, rates: Rates) -> str:
    ticks = direction.link_ticks + direction.tick_wait_ticks
    text = f"a delay of {direction.link_ticks * rates.tick_s * 1e3:g} ms is {direction.link_ticks:g} device ticks"
    if not direction.whole:
        text += f", no whole number: taken as {ticks:g}, as a receiver sees it at its next tick"
    if direction.frame_wait_ticks:
        border = ticks + direction.frame_wait_ticks
        frames = border / rates.ticks_per_frame
        text += (
            f"; it is played at the next frame border, after {border:g} ticks or {frames:g} frame{'s' * (frames != 1)}"
        )
    return text


def _damping(user: User) -> float:
    address = parse_address(address_of(user))
    if address.scheme != "sim":
        return 0.0  # a capability record names no damping of the bare device
    return float(address.query.get("damping_nspm", user.device_damping_nspm))
