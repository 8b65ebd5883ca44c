"""Advice on haptic effects: what a device renders of those that settings tell (theory 7.8)."""

from math import inf

from cogrip.client.effects.effect_force import LAWS
from cogrip.client.effects.laws import ActiveLaw
from cogrip.client.hand.velocity import lag_ticks, largest_impedance
from cogrip.client.safety.rendered_damper import damper_on
from cogrip.devices.device import MOST_SLOPE_NPS, Capability
from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.effects import Effect
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings


def effect_advice(settings: Settings, seat: SeatSettings, record: Capability) -> tuple[str, bool]:
    """Return a sentence on one person's effects, and whether all of them are rendered as asked; "" where there are none."""
    own = [(place, each) for place, each in enumerate(settings.effects) if not each.users or seat.user in each.users]
    if not own:
        return "", True
    tick_s = seat.rates.tick_s
    carried, lag_s = largest_impedance(record, tick_s).impedance_nspm, lag_ticks(record, tick_s) * tick_s
    stiffest, left = carried / lag_s if lag_s else inf, max(0.0, carried - damper_on(seat, record).value_nspm)
    slope = min(record.slew_nps, MOST_SLOPE_NPS)
    said = [
        f"effects.{place}.{text}" for place, each in own if (text := _too_much(each, stiffest, left, slope, tick_s))
    ]
    if said:
        return f"{seat.user}: of haptic effects the device renders less: {'; '.join(said)}", False
    text = (
        f"{len(own)} haptic effects, each rendered as asked: springs to {stiffest:.4g} N/m, dampers to {left:.3g} N s/m"
    )
    return f"{seat.user}: {text}", True


def _too_much(effect: Effect, stiffest_npm: float, left_nspm: float, slope_nps: float, tick_s: float) -> str:
    """Return which value of an effect is more than a device renders, and the most that it does; "" where none is."""
    if effect.stiffness_npm > stiffest_npm:
        return f"stiffness_npm = {effect.stiffness_npm:g}, of which at most {stiffest_npm:.4g}"
    if effect.damping_nspm > left_nspm:
        return f"damping_nspm = {effect.damping_nspm:g}, of which at most {left_nspm:.3g}, what the coupling leaves"
    law, part = LAWS[effect.kind](effect, PLACES, tick_s), 1.0
    if isinstance(law, ActiveLaw) and law.slope_nps:
        part = slope_nps / law.slope_nps
    elif isinstance(law, ActiveLaw):
        part = stiffest_npm / law.stiffness_npm
    most_n = part * effect.amplitude_n
    return f"amplitude_n = {effect.amplitude_n:g}, of which at most {most_n:.3g}" if part < 1.0 else ""
