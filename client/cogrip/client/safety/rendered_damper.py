"""The damper that the settings of a seat ask of its device, compared with what that device carries.

Settings are the server's, and the device is the client's: a client judges its own device with every seat it is given.
"""

from math import floor, log10
from typing import NamedTuple

from cogrip.client.hand.velocity import NOISE_N, Carried, largest_impedance
from cogrip.devices.device import Capability, DeviceError
from cogrip.protocol.settings.coupling import Coupling
from cogrip.protocol.settings.seat import SeatSettings

ROUNDING = 1e-9  # relative excess over a bound that is rounding: settings are decimal


class OverloadError(DeviceError):
    """The settings of a seat ask a device for more than it carries; the text says the value that would do."""


class Damper(NamedTuple):
    """The damper that a device itself renders: b of waves and passivity control, B of virtual coupling. key: of [coupling]."""

    symbol: str
    key: str
    value_nspm: float


def damper_of(coupling: Coupling) -> Damper:
    """Return the damper in the client's own force law."""
    symbol, key = coupling.traits.damper
    return Damper(symbol, key, getattr(coupling, key))


def seat_on(seat: SeatSettings, record: Capability) -> SeatSettings:
    """Return the seat as a client begins it on this device: where b is "auto", with that which the device carries."""
    if not seat.line.auto_impedance:
        return seat
    carried = largest_impedance(record, seat.rates.tick_s).impedance_nspm
    if seat.tool:
        carried /= seat.tool.stiffest(seat.object.axes)
    return seat.at_impedance(seat.tuning_on(seat.loop_s, carried).impedance_nspm)


def damper_on(seat: SeatSettings, record: Capability) -> Damper:
    """Return the damper that this device renders in this seat."""
    return damper_of(seat_on(seat, record).coupling)


def refusal(seat: SeatSettings, record: Capability, section: str = "coupling") -> str:
    """Return why the device must not be driven so, with the value that would do; "" where it carries what is asked.

    section: of the settings, in which the value stands.
    """
    damper, tick_s = damper_on(seat, record), seat.rates.tick_s
    carried = largest_impedance(record, tick_s)
    stiffest = seat.tool.stiffest(seat.object.axes) if seat.tool else 1.0  # by which the hand feels more of it
    most, symbol = carried.impedance_nspm / stiffest, damper.symbol
    if damper.value_nspm <= most * (1.0 + ROUNDING):
        return ""
    fraction = stiffest * damper.value_nspm * tick_s / record.apparent_mass_kg
    scaled = f", with force_scale = {seat.tool.force_scale:g}," if seat.tool and stiffest != 1.0 else ""
    return (
        f"{seat.user}: {symbol} = {damper.value_nspm:g} N s/m{scaled} is more than device {record.family}:{record.model} "
        f"carries: "
        f"{symbol} T_c / m = {fraction:.2f}; at {most:.3g} N s/m, its {carried.bound} bound, {bound_words(carried, record)}; "
        f"set {section}.{damper.key} to {rounded_down(most):g} or less"
    )


def bound_words(carried: Carried, record: Capability) -> str:
    """Return in words which bound binds at the largest b."""
    if carried.bound == "lag":
        return f"the {carried.lag_ticks:.2g} ticks that its damper is late take all of its {record.apparent_mass_kg:.3g} kg"
    if carried.bound == "noise":
        return f"one count of {1e3 * record.resolution_m:.3g} mm makes its force jump by {NOISE_N:g} N"
    return "the damping that its record advises ends"


def rounded_down(value: float) -> float:
    """Return the value to three digits, and not above it."""
    if not value > 0.0:
        return 0.0
    step = 10.0 ** (floor(log10(value)) - 2)
    return float(f"{floor(value / step * (1.0 + ROUNDING)) * step:.3g}")
