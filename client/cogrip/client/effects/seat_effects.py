"""Effects of a seat that was told none, so that a tick need not ask whether there are any; then `EffectForce` has its place."""

from collections.abc import Sequence

from cogrip.client.hand.frame import HandFrame
from cogrip.client.safety.device_port import DevicePort
from cogrip.client.safety.limiter import Safety
from cogrip.devices.device import Capability
from cogrip.protocol.wire.accounts import EffectAccount

Row = tuple[float, ...]


class SeatEffects:
    """No effects: nothing is rendered, and no energy moves. Forces are shape (axes,) [N].

    present   whether there are any
    asked_n   force of this tick, before ramp and limits; None where there is none
    stored_j  in springs, as far as they are rendered
    work_j    of the hand against all effects so far
    reduced   whether less than was asked for is rendered, for the device's sake
    """

    def __init__(self) -> None:
        self.present = False
        self.asked_n: Row | None = None
        self.stored_j = self.work_j = 0.0
        self.reduced = False

    def fit(self, record: Capability, free_j: float) -> None:
        """Set the device record. free_j: what the device port lends before it does anything about it."""

    def forget(self) -> None:
        """End all effects: another server tells its own."""

    def begin_anew(self) -> None:
        """Render nothing from now on, and let each effect come again: what springs held is lost."""

    def enter(
        self,
        elapsed: int,
        held_n: Sequence[float],
        acting_n: Sequence[float],
        start_m: Sequence[float],
        end_m: Sequence[float] | None,
    ) -> Sequence[float]:
        """Enter a displacement of the hand. Return the coupling's part of what acted in it.

        held_n: to the motors over these `elapsed` ticks; acting_n: while the hand moved so, where samples are old
        """
        return acting_n

    def added(
        self, tick: int, coupling_n: Sequence[float], hand_m: Row, hand_mps: Sequence[float], safety: Safety, port: DevicePort,
        frame: HandFrame,
    ) -> Sequence[float]:  # fmt: skip
        """Return the coupling's law at the hand with all effects."""
        return coupling_n

    def watched(self, local_n: Sequence[float], force_n: Row, gain: float) -> tuple[Sequence[float], Sequence[float]]:
        """Return for the detector of oscillation what follows the hand's motion, and the force less what follows time."""
        return local_n, force_n

    def rest_of(self, force_n: Row) -> Row:
        """Return a force without the effects' part of what acted last."""
        return force_n

    def account(self) -> EffectAccount | None:
        """Return the account; None where no effect was ever told."""
        return None
