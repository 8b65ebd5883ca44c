"""Implausible inputs: motion in the wrong unit, amplitudes of metres, masses of lorries.

A finding that warns names the input, its value, the bound and the cure; one that is `refused` is so far off that no run of it
would mean anything. docs/verdict.md lists the bounds, which are of hands and devices on tables.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite

from cogrip.analysis.advice.finding import Finding
from cogrip.devices.device import Capability, Device, DeviceError
from cogrip.devices.emulated.emulated_device import EmulatedDevice
from cogrip.devices.emulated.mechanics import STEP_HZ
from cogrip.devices.for_user import address_of, make_for
from cogrip.devices.replayed.replayed_device import ReplayedDevice
from cogrip.devices.simulated.hands import DirectedHand, Hand, PushHand
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.room import rates_of, seat_axes
from cogrip.protocol.settings.sections import Settings

FAR_OUTSIDE = 2.0
"""Distance from a workspace's middle, in half widths, above which a motion is refused: a hand may mean to press a little
beyond an end, not so far."""
LONG_REACH_M, MOST_REACH_M = (
    1.0,
    2.0,
)  # motions that are said, and refused: an arm reaches 0.7 m, and 2 m are another unit
QUICK_MPS, MOST_MPS = (
    3.0,
    10.0,
)  # speeds that are said, and refused: a quick reach peaks at 2 m/s, a thrown ball leaves the hand at 10
HEAVY_KG, MOST_KG = 20.0, 100.0  # masses that are said, and refused: a hand on a desk moves neither
_SAMPLES = 20_000  # most samples of a motion: a hand's bandwidth is some hertz
_AXES = "xyz"


@dataclass(frozen=True, slots=True)
class MotionExtremes:
    """The extremes of a motion: (low, high) per axis [m], and the largest speed on any axis [m/s]."""

    range_m: tuple[tuple[float, float], ...]
    speed_mps: float


def implausible(settings: Settings) -> list[Finding]:
    """Return findings on what hands and devices do not do, in the settings and their recordings. Raises DeviceError."""
    found = list(_masses(settings))
    for user in settings.users:
        if user.device.startswith(("sim:", "emulated:", "replay:")):
            rate_hz = rates_of(settings, user).device_hz
            device = make_for(user, seat_axes(settings, user))
            found += hand_findings(user.name, address_of(user), device, rate_hz, settings.seconds)
    return found


def hand_findings(name: str, address: str, device: Device, rate_hz: int, seconds: float) -> list[Finding]:
    """Return findings on one device in a simulated or recorded hand, which is opened and closed. Raises DeviceError."""
    device.open(rate_hz)
    try:
        hand = _hand_of(device)
        if isinstance(hand, PushHand):
            return list(_push(name, hand, device.capability))
        if hand is not None:
            hand_hz = STEP_HZ if isinstance(device, EmulatedDevice) else rate_hz
            motion = _intended(hand, device.capability.axes, hand_hz, seconds)
        elif isinstance(device, ReplayedDevice):
            motion = _played(device, rate_hz, seconds)
        else:
            return []
    finally:
        device.close()
    return list(_motion(name, address, motion, device.capability))


def _hand_of(device: Device) -> Hand | None:
    if isinstance(device, SimulatedDevice):
        return device.hand
    return device.firmware.mechanics.body.hand if isinstance(device, EmulatedDevice) else None


def _ticks(rate_hz: int, seconds: float) -> range:
    ticks = max(1, round(seconds * rate_hz))
    return range(0, ticks, max(1, ticks // _SAMPLES))


def _intended(hand: Hand, axes: int, rate_hz: int, seconds: float) -> MotionExtremes:
    places, speed = [], 0.0
    ticks: Sequence[int] = _ticks(rate_hz, seconds)
    if isinstance(hand, DirectedHand):  # every axis has its extremes where the one direction has them
        along, velocities = zip(*map(hand.along, ticks), strict=True)
        speeds = tuple(map(abs, velocities))
        ticks = [ticks[values.index(most(values))] for values, most in ((along, min), (along, max), (speeds, max))]
    for tick in ticks:
        position, velocity = hand.intended(tick)
        places.append(position[:axes])
        speed = max(speed, max(map(abs, velocity[:PLACES])))
    return MotionExtremes(tuple((min(axis), max(axis)) for axis in zip(*places, strict=True)), speed)


def _played(device: ReplayedDevice, rate_hz: int, seconds: float) -> MotionExtremes:
    ticks = _ticks(rate_hz, seconds)
    places = [device.read(tick).position_m for tick in ticks]
    steps = [abs(after - before) for one, other in pairwise(places) for before, after in zip(one, other, strict=True)]
    ranges = tuple((min(axis), max(axis)) for axis in zip(*places, strict=True))
    return MotionExtremes(ranges, max(steps, default=0.0) * rate_hz / ticks.step)


def _motion(name: str, address: str, motion: MotionExtremes, record: Capability) -> Iterator[Finding]:
    cure = _cure(address)
    for axis, ((low, high), (first, last)) in enumerate(zip(motion.range_m, record.workspace_m, strict=False)):
        far = high if abs(high) >= abs(low) else low
        if not isfinite(low + high) or high - low > LONG_REACH_M:
            text = f"{name}: the hand means to move by {high - low:.3g} m along {_AXES[axis]}"
            text = f"{text}; an arm reaches {LONG_REACH_M:g} m; {cure}"
            yield Finding("hand", text, "warning", refused=not high - low <= MOST_REACH_M)
            continue
        middle, half = 0.5 * (first + last), 0.5 * (last - first)
        outside = max(high - middle, middle - low)
        if outside > half * (1.0 + 1e-9):
            text = (
                f"{name}: the hand means to go to {far:.3g} m along {_AXES[axis]}, beyond the {first:g} to {last:g} m of "
                f"device {record.family}:{record.model}, whose end would stop it"
            )
            yield Finding("hand", f"{text}; {cure}", "warning", refused=outside > FAR_OUTSIDE * half)
    most = min(QUICK_MPS, record.speed_mps)
    if motion.speed_mps > most:
        whose = "a quick hand reaches" if most == QUICK_MPS else f"device {record.family}:{record.model} faults above"
        text = f"{name}: the hand means to move at {motion.speed_mps:.3g} m/s; {whose} {most:g} m/s"
        yield Finding("hand", f"{text}; {cure}", "warning", refused=motion.speed_mps > MOST_MPS)


def _cure(address: str) -> str:
    if "csv" in address:
        return "check the units: scale=0.001 reads millimetres, time_scale=0.001 milliseconds"
    if address.startswith("replay:") or "hand=recording:" in address:
        return "name a recording of such a device, or give it another device"
    return "give the hand less amplitude_m, or more time for it"


def _push(name: str, hand: PushHand, record: Capability) -> Iterator[Finding]:
    force = max(map(abs, hand.force_n))
    if force > record.peak_force_n:
        yield Finding(
            "hand",
            f"{name}: the hand pushes with {force:g} N, more than the {record.peak_force_n:g} N that device "
            f"{record.family}:{record.model} can hold against it: it runs off; give it less force_n",
            "warning",
        )


def _masses(settings: Settings) -> Iterator[Finding]:
    masses = [
        ("object.mass_kg", settings.object.mass_kg, settings.object.traits.plain and not settings.object.traits.fixed)
    ]
    for number, user in enumerate(settings.users):
        with suppress(DeviceError):  # said where the device is opened
            mass_kg = make_for(user, seat_axes(settings, user)).capability.apparent_mass_kg
            masses.append((f"users.{number}.device_mass_kg", mass_kg, user.device.startswith("sim:")))
    for key, mass_kg, counts in masses:
        if counts and mass_kg > HEAVY_KG:
            yield Finding(
                "mass",
                f"{key} = {mass_kg:g} kg is more than the {HEAVY_KG:g} kg that a hand moves on a desk; give it in kg, "
                f"and no more than {HEAVY_KG:g}",
                "warning",
                refused=mass_kg > MOST_KG,
            )
