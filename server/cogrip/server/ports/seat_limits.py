"""Bounds of what a seat may bring in: a hostile player can be unpleasant, never dangerous.

    waves     |u| <= (b V + F) / sqrt(2b), with peak force F and speed V of the device record that was claimed; where that
              has no bound, [admission]'s, or REMOTE's; where a hand turns also (b_r V_r + M) / sqrt(2 b_r), with peak torque M
              and angular speed V_r, where it drives a gripper also (b_g V + F) / sqrt(2 b_g), of the gripper
    power     into the object on average over BURST_S; what the settings say (by default a hand's), or the device's own F V
    states    (virtual coupling, time-domain passivity) speed V, and no farther in one frame than V lets a hand go
    energy    (time-domain passivity) that power as well, whatever energy the client says it has sent

A wave that is limited keeps its direction and loses energy, so everything stays passive.
"""

from collections import Counter
from collections.abc import Sequence
from math import inf, sqrt
from sys import float_info

import msgspec

from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.laws.waves import wave_of
from cogrip.protocol.settings.sections import REMOTE, Settings
from cogrip.protocol.settings.tool_frame import ToolFrame
from cogrip.protocol.wire.messages import NO_BOUND, Hello, Latest

BURST_S = 0.25  # time whose power a seat may bring in at once

LARGEST = float_info.max  # largest finite bound; inf stands for none, which compiled code compares as an object
MOST_S = 2.0  # longest time between two states in which a hand may have moved
FASTER = 1.01  # factor by which a sender's clock may be faster than ours


class ClaimedRecord(msgspec.Struct, frozen=True):
    """Device record, as a hello claims it."""

    device: str
    axes: int
    rate_hz: float
    force_n: float
    speed_mps: float
    torque_nm: float = 0.0
    speed_radps: float = 0.0


class SeatLimits(msgspec.Struct, frozen=True):
    """Bounds of one seat; inf where there is none. torque_nm, speed_radps: of a gripper its force [N] and speed [m/s]."""

    force_n: float = inf
    speed_mps: float = inf
    power_w: float = inf
    torque_nm: float = 0.0
    speed_radps: float = 0.0

    def or_more(self, other: "SeatLimits") -> "SeatLimits":
        """Return the looser bound of both."""
        return SeatLimits(*map(max, msgspec.structs.astuple(self), msgspec.structs.astuple(other)))

    def square_of(self, impedance_nspm: float, further_impedance: float) -> float:
        """Return the largest |u|^2 of all axes [W]. further_impedance: b_r [N m s] or b_g [N s/m]."""
        largest = wave_of(impedance_nspm, self.speed_mps, self.force_n)
        other = wave_of(further_impedance, self.speed_radps, self.torque_nm)
        return largest * largest + other * other


def record_of(hello: Hello) -> ClaimedRecord:
    """Return the device record of a hello."""
    axes, rate_hz = hello.device_axes, hello.device_rate_hz
    turning = hello.device_torque_nm, hello.device_speed_radps
    return ClaimedRecord(hello.device, axes, rate_hz, hello.device_force_n, hello.device_speed_mps, *turning)


def limits_of(record: ClaimedRecord, settings: Settings, number: int, tool: ToolFrame | None = None) -> SeatLimits:
    """Return the bounds of seat `number` with this device record. tool: how the hand moves its tool (theory 1.1)."""
    admission = settings.admission

    def bound(name: str) -> float:
        claim: float = getattr(record, name)
        return claim if claim < NO_BOUND else getattr(admission, name) or REMOTE[name]

    force, speed, torque, turning = [bound(name) for name in ("force_n", "speed_mps", "torque_nm", "speed_radps")]
    if settings.users[number].grips:  # the record's force and speed are the larger of arm and gripper
        torque, turning = force, speed
    if tool is not None:
        scale, weight = tool.position_scale, tool.force_scale / tool.position_scale**2
        force, speed, torque = force / (scale * weight), scale * speed, torque / weight
    asked = settings.users[number].power_w
    power = admission.power_w if asked is None else asked
    return SeatLimits(force, speed, power or force * speed + torque * turning, torque, turning)


def misclaimed(record: ClaimedRecord, settings: Settings, number: int) -> str:
    """Return why seat `number` does not accept this device record, "" if it does."""
    admission, user = settings.admission, settings.users[number]
    for claim, bound, unit, key, kind in (
        (record.force_n, admission.force_n, "N", "force_n", "weaker"),
        (record.speed_mps, admission.speed_mps, "m/s", "speed_mps", "slower"),
        (record.torque_nm, admission.torque_nm, "N m", "torque_nm", "weaker"),
        (record.speed_radps, admission.speed_radps, "rad/s", "speed_radps", "slower"),
    ):
        if bound is not None and bound < claim < NO_BOUND:
            return (
                f"{record.device} claims {claim:g} {unit}, more than admission.{key} = {bound:g}: "
                f"use a {kind} device, or ask for a higher limit"
            )
    listed, claimed = kind_of_device(user.device), kind_of_device(record.device)
    if admission.devices == "listed" and claimed != listed:
        return f"the seat of {user.name!r} is for {listed}, and {claimed} is claimed: join with the listed device"
    return ""


def kind_of_device(address: str) -> str:
    """Return a device address without its keys."""
    return address.partition("?")[0].partition("#")[0]


class PowerBucket:
    """Token bucket of energy: fills by `power_w`, holds that of BURST_S. counts: limitations by reason."""

    def __init__(self, frame_s: float, limits: SeatLimits, power_left: float = 1.0) -> None:
        """power_left: initial level, of 1."""
        self._frame_s = frame_s
        PowerBucket.set_limits(self, limits)
        self._level_j = self._burst_j * power_left if self._burst_j < inf else inf
        self.counts: Counter[str] = Counter()

    def set_limits(self, limits: SeatLimits) -> None:
        """Fill by the power of these limits from now on; what is in the bucket stays."""
        self._refill_j = limits.power_w * self._frame_s
        self._burst_j = limits.power_w * BURST_S

    @property
    def fullness(self) -> float:
        """Level, of 1."""
        return self._level_j / self._burst_j if 0.0 < self._burst_j < inf else 1.0


class WaveLimiter(PowerBucket):
    """Bounds forward waves: `limit` one before the step, `book` the returned wave after it. Waves [sqrt(W)], shape (axes,).

    A step may take in at most the energy of the last returned wave and what the bucket holds. So the energy taken in up to any
    time is at most power * (time + BURST_S) and one returned wave. A hand that holds still under any force returns what it
    brings and is never limited.
    """

    def __init__(
        self,
        impedance_nspm: float,
        frame_s: float,
        limits: SeatLimits,
        power_left: float = 1.0,
        further_impedance: float = 1.0,
    ) -> None:
        super().__init__(frame_s, limits, power_left)
        self._limits = limits
        self._ratio = further_impedance / impedance_nspm  # b_r / b, or b_g / b, which stays
        self.set_impedance(impedance_nspm)
        self._half_frame_s = 0.5 * frame_s
        self._brought = 0.0  # |u|^2 of this step
        self._returned = 0.0  # |v|^2 of the last step
        self.taken_j = 0.0  # energy by which waves were limited

    def set_limits(self, limits: SeatLimits) -> None:
        """Bound by these limits from now on."""
        super().set_limits(limits)
        self._limits = limits
        self.set_impedance(self._impedance_nspm)

    def set_impedance(self, impedance_nspm: float) -> None:
        """Bound waves as of this impedance from now on."""
        self._impedance_nspm = impedance_nspm
        self._largest_square = self._limits.square_of(impedance_nspm, self._ratio * impedance_nspm)

    def limit(self, wave: Row) -> Row:
        square = 0.0
        for value in wave:
            square += value * value
        allowed, name = self._largest_square, "wave clipped"
        if self._level_j <= LARGEST:
            powered = self._returned + max(0.0, self._level_j) / self._half_frame_s
            if powered < allowed:
                allowed, name = powered, "power limited"
        if square > allowed:
            self.counts[name] += 1
            gain = sqrt(allowed / square)
            wave = tuple([gain * value for value in wave])
            self.taken_j += (square - allowed) * self._half_frame_s
            square = allowed
        self._brought = square
        return wave

    def book(self, returned: Row) -> None:
        square = 0.0
        for value in returned:
            square += value * value
        if self._level_j <= LARGEST:
            level = self._level_j + self._refill_j - (self._brought - square) * self._half_frame_s
            self._level_j = min(self._burst_j, level)
        self._returned = square


class LineEnergyLimiter(PowerBucket):
    """Bounds the energy that comes out of a line: `limit` it before a step, `book` the net energy after it. Rows in J.

    The bucket is that of `WaveLimiter`: a line brings in at most power * (time + BURST_S), whatever its client claims to have
    sent.
    """

    def __init__(self, frame_s: float, limits: SeatLimits, power_left: float = 1.0) -> None:
        super().__init__(frame_s, limits, power_left)
        self._held = False  # the bucket bounds this step, not what was received
        self._allowed_j = 0.0

    def limit(self, left_j: Sequence[float]) -> Row:
        """Return the bound of each axis: an even part of what the bucket holds at most."""
        if self._level_j == inf:
            return tuple(left_j)
        part = max(0.0, self._level_j) / len(left_j)
        self._held, self._allowed_j = max(left_j) > part, part
        return tuple([min(left, part) for left in left_j])

    def book(self, net_j: float, asked_j: float) -> None:
        """net_j: of all axes; asked_j: on the axis with the most, at the speed that was asked for."""
        if self._level_j == inf:
            return
        if self._held and asked_j > self._allowed_j:
            self.counts["power limited"] += 1
        self._level_j = min(self._burst_j, self._level_j + self._refill_j - net_j)


class StateLimiter:
    """Plausibility of the states of a hand that sends no waves: neither faster nor farther than its record allows."""

    def __init__(self, frame_s: float, limits: SeatLimits) -> None:
        self._frame_s = frame_s
        self._most_frames = round(MOST_S / frame_s)
        self._speed_mps = limits.speed_mps
        self._last: Latest | None = None
        self._frames_left = float(self._most_frames)  # for which a hand may have moved, by the server's steps
        self.counts: Counter[str] = Counter()

    def set_limits(self, limits: SeatLimits) -> None:
        """Judge by these limits from now on."""
        self._speed_mps = limits.speed_mps

    def step(self, frames: int) -> None:
        """Count the frames of one server step, whatever numbers a client gives to its states."""
        self._frames_left = min(float(self._most_frames), self._frames_left + FASTER * frames)

    def fits(self, state: Latest) -> bool:
        """Return whether a state is plausible. The place of a late one is not judged, as it is not applied."""
        if self._speed_mps == inf:
            return True
        last, speed = self._last, self._speed_mps
        square = add_floats([value * value for value in state.velocity_mps])
        moved = 0.0
        reach = inf
        if last is not None and state.number > last.number:
            moved = add_floats([(a - b) ** 2 for a, b in zip(state.position_m, last.position_m, strict=True)])
            reach = speed * self._frame_s * min(self._frames_left, state.number - last.number)
        if square > speed * speed or moved > reach * reach:
            self.counts["state out of bounds"] += 1
            return False
        return True

    def took(self, state: Latest) -> None:
        """Judge the next state from this one, which was received."""
        if self._last is None:
            self._last = state
        elif state.number > self._last.number:
            self._frames_left = max(0.0, self._frames_left - (state.number - self._last.number))
            self._last = state
