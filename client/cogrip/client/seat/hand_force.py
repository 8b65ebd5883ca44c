"""Force of a tick at a hand: of coupling and sources, limited by energy, then by safety.

The whole of it is `force`, from what coupling and sources wish to what the motors hold until the next tick. What limits took
goes back to the coupling, which must not be given energy for force that no hand felt.
"""

from collections.abc import Sequence
from math import inf

from cogrip.client.coupling.interface import Coupling
from cogrip.client.hand.frame import HandFrame
from cogrip.client.rows.springs import part_of
from cogrip.client.safety.device_port import Cause, DevicePort
from cogrip.client.safety.limiter import Safety
from cogrip.client.safety.shaking import Shaking
from cogrip.client.seat.hand_motion import HandMotion
from cogrip.client.sources.force_source import AtHand, ForceSources


class HandForce:
    """Sum of the forces at a hand, and their limits. Rows are shape (axes,), in lengths.

    coupling  of the line in use
    port      limit by energy, and detector of oscillation
    cause     why the force of the newest tick is to be released; "" where it may stay
    """

    __slots__ = ("cause", "coupling", "port", "safety", "shaking", "sources")

    def __init__(
        self, coupling: Coupling, sources: ForceSources, port: DevicePort, safety: Safety, shaking: Shaking
    ) -> None:
        self.coupling, self.sources, self.port, self.safety, self.shaking = coupling, sources, port, safety, shaking
        self.cause: Cause = ""

    def force(self, tick: int, hand: HandMotion, frame: HandFrame) -> tuple[float, ...]:
        """Return the force of this tick [N]."""
        coupling, safety, port, sources = self.coupling, self.safety, self.port, self.sources
        at_m, velocity = hand.position_m, hand.velocity_mps
        port.elapse()
        coupling.carried_nspm = carried = port.carried.nspm / frame.stiffest
        coupling.cut_n = wanted_n = limited_n = None
        if safety.state == "fault":
            sources.begin_anew()
        else:
            wanted_n = frame.hand_force(coupling.force(frame.place(at_m), frame.rates(velocity)))
            if sources.present:
                carried_npm = carried / port.lag_s if port.lag_s else inf
                at = AtHand(tick, at_m, velocity, frame, safety.coming_gain(), carried, carried_npm)
                wanted_n = sources.added(wanted_n, at)
            sources.wish_n = wanted_n = port.damped(wanted_n, velocity)
            limited_n = port.limit(wanted_n)
        force = safety.limit(limited_n, coupling.gap())
        coupling.ramp_gain, port.ramped = safety.gain, safety.gain != 1.0
        self.cause = ""
        if wanted_n is not None and safety.state == "live":
            self._watch(wanted_n, force, frame)
        if port.ramped or safety.state != "live" or self.cause:
            self.shaking.pause()
        else:
            self.shaking.enter(sources.rest_of(force) if sources.present else force)
        return force

    def _watch(self, wanted_n: Sequence[float], force: tuple[float, ...], frame: HandFrame) -> None:
        """Tell the coupling what limits took of its part of the force, and let the port look whether the force oscillates."""
        coupling, safety, port, sources = self.coupling, self.safety, self.port, self.sources
        local_n: Sequence[float] = frame.hand_force(coupling.local_n)
        watched_n: Sequence[float] = force
        reduced = coupling.reduced
        if sources.asked_n is not None:
            local_n, watched_n = sources.watched(local_n, force, safety.gain)
            reduced = reduced or sources.reduced
        if port.ramped:
            local_n = [safety.gain * local for local in local_n]
        elif (clamped_n := safety.clamped_n) is not wanted_n:
            # The line must not be given energy for force that limits removed
            if (others_n := sources.asked_n) is None:
                cut_n = [wish - left for wish, left in zip(wanted_n, clamped_n, strict=True)]
            else:
                fraction = 1.0 - part_of(clamped_n, wanted_n)
                cut_n = [fraction * (wish - other) for wish, other in zip(wanted_n, others_n, strict=True)]
            coupling.cut_n = frame.tool_force(cut_n)
        self.cause = port.watch(watched_n, safety.at_peak(), local_n, safety.limited, reduced, coupling.absorbs)
