"""Spring of a seat that was changed while its session runs: stiffness and damper go to what was set (theory 3.7)."""

from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.seats.ramp import Ramp

LEAST_NPM, LEAST_NSPM = 10.0, 1.0  # below these a ramp goes as at these


class SpringRamp:
    """Call `update` once a frame.

    stiffness  K [N/m]; a world reaches it as fast as is paid for
    damping    B [N s/m]
    """

    def __init__(self, seat: SeatSettings) -> None:
        """seat: settings of the seat as they hold now."""
        frame_s = seat.rates.frame_s
        self.stiffness = Ramp(seat.rendered_npm, LEAST_NPM, frame_s)
        self.damping = Ramp(seat.coupling.damping_nspm, LEAST_NSPM, frame_s)

    def aim(self, seat: SeatSettings) -> None:
        """Go to the spring of these settings."""
        self.stiffness.goal, self.damping.goal = seat.rendered_npm, seat.coupling.damping_nspm
