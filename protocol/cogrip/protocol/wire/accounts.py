"""Accounts of a session by each end, exchanged in its last two messages and joined in `summary.json` (SPEC.md 3.9, 3.10)."""

from typing import Annotated

import msgspec

from cogrip.machine.tick_count import Percentiles, TickCount

REASON_BYTES = 280  # longest reason with which a client's account still fits a datagram once it is encrypted
LEFT, SATURATED = 1, 2  # bits of a client's `incidents`: one byte, as the largest account has no room for more
AxisNumbers = Annotated[tuple[float, ...], msgspec.Meta(max_length=6)]  # one number for each axis


class LinkCount(msgspec.Struct, frozen=True, array_like=True):
    """Frames of one direction by fate: sent = applied + late + lost (`SPEC.md` section 6)."""

    sent: int = 0
    received: int = 0
    applied: int = 0
    lost: int = 0
    late: int = 0
    duplicate: int = 0
    pending: int = 0


class PlayoutAccount(msgspec.Struct, frozen=True, array_like=True):
    """Playout of one direction's frames."""

    depth_frames: float = 0.0  # mean over all frames
    least_frames: float = 0.0
    most_frames: float = 0.0
    repeated: int = 0  # times that the playout delay was made longer
    skipped: int = 0  # times that the playout delay was made shorter
    concealed: int = 0  # frames that were missing when they were due
    longest_gap: int = 0  # most frames in a row that were concealed


class DelayAccount(msgspec.Struct, frozen=True, array_like=True):
    """One-way delays between client and server as the client measured them [ms]; None where nothing was measured."""

    up_ms: Percentiles = Percentiles()  # one-way delay by the clocks, as far as their offset is known
    down_ms: Percentiles = Percentiles()
    offset_ms: float | None = None  # the server's clock less the client's
    uncertainty_ms: float | None = None  # uncertainty of the offset: half the least round trip (`protocol.wire.clock`)


Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]  # fraction of the ticks in which the device may give force


class DeviceAccount(msgspec.Struct, frozen=True, array_like=True):
    """The device port of one person: energy through the motors, and limits on the force (docs/device_port.md)."""

    oscillates: bool = False  # the force oscillated fast and was released for it
    at_limit: Fraction = 0.0  # ticks in which a limit of the device held the force
    controlled: Fraction = 0.0  # ticks in which the device port changed the force, or rendered less than was asked
    # largest energy that the hand was given beyond what it had put in, the line had given and the device's damping takes
    leak_j: float = 0.0
    margin_j: float | None = None  # least energy reserve of the port, its reserve included; below 0: not passive
    let_go: int = 0  # times that the force was released: it oscillated, stayed at its limit, or ran out of energy
    reserve_j: float | None = None  # least of the energy that the port could still give, after the first second
    budget_j: float | None = None  # energy that the port may give out beyond what came in (its reserve, E_0)
    shake_n: float | None = None  # largest rms of the force above 12 Hz that lasted half a second [N]


class LineAccount(msgspec.Struct, frozen=True, array_like=True):
    """Impedance [N s/m] and corner of the wave filter [Hz], 0 for none: at the end, least and most."""

    impedance_nspm: float
    least_impedance_nspm: float
    most_impedance_nspm: float
    wave_filter_hz: float
    least_filter_hz: float
    most_filter_hz: float


class EffectAccount(msgspec.Struct, frozen=True, array_like=True):
    """Haptic effects that a client rendered, and their energy tank (docs/effects.md)."""

    least_tank_j: float = 0.0  # least energy that the tank held, less what late ticks drew beyond it
    drawn_j: float = 0.0  # energy that active effects drew in all
    reduced_s: float = 0.0  # time in which less was rendered than asked for, for the device's sake or the tank's


class ClientAccount(msgspec.Struct, frozen=True, array_like=True):
    """Account of one person's client at the end of a session."""

    position_m: AxisNumbers
    force_n: AxisNumbers
    peak_force_n: float
    travel_m: float
    felt_stiffness_npm: float | None
    predicted_stiffness_npm: float | None
    down_margin_j: float | None
    device_leak_j: float
    down: LinkCount
    rtt_ms: Percentiles
    ticks: TickCount
    unstable: bool  # a force oscillated until it was a fault, was not finite, or took out energy without end
    state: Annotated[str, msgspec.Meta(max_length=40)]
    reason: Annotated[str, msgspec.Meta(max_length=REASON_BYTES)]
    peak_step_n: float = 0.0  # largest change of the force from one tick to the next
    playout: PlayoutAccount | None = None  # account of the downlink; None without waves
    delay: DelayAccount = DelayAccount()
    device: DeviceAccount = DeviceAccount()
    down_reserve_j: float | None = None  # least reserve of the downlink after its first second
    peak_torque_nm: float = 0.0  # largest torque; of a seat with a gripper its largest force [N]
    line: LineAccount | None = None  # account of the last line; None without waves
    effects: EffectAccount | None = None  # account of the effects; None where none were told
    # sum of LEFT and SATURATED; later versions have other bits
    incidents: Annotated[int, msgspec.Meta(ge=0, le=127)] = 0

    @property
    def left(self) -> bool:
        """Return whether the hand was outside of its device's workspace."""
        return bool(self.incidents & LEFT)

    @property
    def saturated(self) -> bool:
        """Return whether the force sat at the device's limit, and was let go."""
        return bool(self.incidents & SATURATED)


class SeatAccount(msgspec.Struct, frozen=True, array_like=True):
    """The server's account of one person at the end of a session."""

    proxy_m: AxisNumbers
    up_margin_j: float | None
    line_margin_j: float | None
    up: LinkCount
    playout: PlayoutAccount | None = None  # account of the uplink; None without waves
    rendered_npm: float | None = None  # stiffness of the spring as it was integrated last
    up_reserve_j: float | None = None  # least reserve of the uplink after its first second
    line_reserve_j: float | None = None  # least reserve of the whole line after its first second


class RoomAccount(msgspec.Struct, frozen=True, array_like=True):
    """The server's account of the object."""

    position_m: AxisNumbers
    velocity_mps: AxisNumbers
    travel_m: float
    unstable: bool  # numbers of the world were not finite, or grew beyond what hands can bring about
    energy_balance_error_j: float
    ticks: TickCount
    left: bool = False  # the object, or a body of the scene, left the workspace
