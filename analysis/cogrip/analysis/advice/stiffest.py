"""The stiffest contact that hands can feel over a link, and its b and K: the inverse of `advice`.

A line of loop time T is as soft as 2b/T, so b is to be large and the loop short (theory 4); the device bounds b, and K is
bounded by stability, which a large b reduces again where velocities are estimated. So: for b from a tenth of what
everybody's device carries up to all of it, the K that is stable with AMPLE to spare; of these pairs the one with the largest
felt stiffness of whoever feels least.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import msgspec

from cogrip.analysis.advice.advice import AMPLE, Advice, advise, ample
from cogrip.analysis.feel.feel import on_wall, slow_feel
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import linear_session
from cogrip.analysis.linear.stability import Limit, largest_stable
from cogrip.client.hand.velocity import largest_impedance
from cogrip.client.safety.rendered_damper import rounded_down
from cogrip.devices.for_user import make_for
from cogrip.protocol.settings.room import rates_of, resolve
from cogrip.protocol.settings.sections import Settings

SHARES = tuple(step / 20.0 for step in range(2, 21))
"""Shares of the damper that everybody's device carries, which are tried."""
NEARLY = 0.99  # share of what the line alone lets through: a stiffer spring is not worth its risk
_NEAR = 1e-3  # relative accuracy of a stiffness
_PROBED_NPM = 1e3  # stiffness at which the line's own softness is read: it does not depend on K
Bounded = Literal["stability", "the line", "the device's record", "sessions"]


@dataclass(frozen=True, slots=True)
class Stiffest:
    """A session and its `overrides`; damper: `coupling.impedance_nspm`, or `damping_nspm` of virtual coupling.

    bounded: the bound of K; limit: up to which K it is stable; advice: on the session with the overrides.
    """

    settings: Settings
    overrides: dict[str, Any]
    damper_nspm: float
    stiffness_npm: float
    bounded: Bounded
    limit: Limit
    advice: Advice

    @property
    def felt_npm(self) -> float:
        """The stiffness at rest of whoever feels least, calculated without jitter and loss."""
        return min(user.felt_npm for user in self.advice.users)


def stiffest(settings: Settings, progress: Callable[[int, int], None] = lambda tried, total: None) -> Stiffest | None:
    """Return the stiffest felt session of everybody with the same b and K; None where none is stable.

    Raises ModelError or DeviceError where there is no model, or no such device.
    """
    key = settings.coupling.traits.damper.key
    carried = min(
        largest_impedance(
            make_for(user, settings.object.axes).capability, rates_of(settings, user).tick_s
        ).impedance_nspm
        for user in settings.users
    )
    found: list[Stiffest] = []
    for number, share in enumerate(SHARES):
        progress(number, len(SHARES))
        damper = rounded_down(share * carried)
        if damper > 0.0 and (best := _with(settings, key, damper)):
            found.append(best)
    return max(found, key=lambda each: (round(each.felt_npm, 6), -each.damper_nspm), default=None)


def eased(found: Stiffest, damper_share: float, stiffness_share: float) -> Stiffest:
    """Return the same with a share of its b and of its K, where sessions did not confirm it."""
    key = found.settings.coupling.traits.damper.key
    damper_nspm, stiffness_npm = (
        rounded_down(damper_share * found.damper_nspm),
        rounded_down(stiffness_share * found.stiffness_npm),
    )
    settings, overrides = _resolved(found.settings, key, damper_nspm, stiffness_npm)
    limit = largest_stable(LiftedModel(linear_session(settings)), relative=_NEAR, beyond=False)
    return Stiffest(
        settings,
        {**found.overrides, **overrides},
        damper_nspm,
        stiffness_npm,
        "sessions",
        limit,
        advise(settings, ample),
    )


def _with(settings: Settings, key: str, damper_nspm: float) -> Stiffest | None:
    """Return the stiffest K with one damper."""
    probe, _ = _resolved(settings, key, damper_nspm, _PROBED_NPM)
    session = linear_session(probe)
    limit = largest_stable(LiftedModel(session), relative=_NEAR, beyond=False)
    if limit.stiffness_npm == 0.0:
        return None
    bounds: list[tuple[float, Bounded]] = []
    if limit.stiffness_npm is not None:
        bounds.append((limit.stiffness_npm / AMPLE, "stability"))
    for number, user in enumerate(probe.users):
        softness = 1.0 / slow_feel(on_wall(session, number), 0).stiffness_npm - 1.0 / _PROBED_NPM  # m/N, of the line
        record = make_for(user, probe.object.axes).capability
        if softness > 0.0:
            bounds.append((NEARLY / (1.0 - NEARLY) / softness, "the line"))
        if 1.0 / record.stiffness_npm > softness:
            bounds.append((1.0 / (1.0 / record.stiffness_npm - softness), "the device's record"))
    K, bounded = min(bounds)
    settings, overrides = _resolved(settings, key, damper_nspm, rounded_down(K))
    advice = advise(settings, ample)
    if not advice.verdict.stable:
        return None
    return Stiffest(settings, overrides, damper_nspm, rounded_down(K), bounded, limit, advice)


def _resolved(
    settings: Settings, key: str, damper_nspm: float, stiffness_npm: float
) -> tuple[Settings, dict[str, Any]]:
    """Return the session with this damper and spring for everybody, users' own values removed, and its overrides."""
    values = {key: damper_nspm, "stiffness_npm": stiffness_npm}
    overrides: dict[str, Any] = {f"coupling.{name}": value for name, value in values.items()}
    if settings.coupling.compensate:
        overrides["coupling.compensate"] = False
    for number, user in enumerate(settings.users):
        overrides |= {
            f"users.{number}.{name}": value for name, value in values.items() if getattr(user, name) is not None
        }
        if user.compensate:
            overrides[f"users.{number}.compensate"] = False
    return resolve(msgspec.to_builtins(settings), overrides), overrides
