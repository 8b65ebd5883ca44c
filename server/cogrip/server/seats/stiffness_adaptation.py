"""Stiffness adaptation: a seat's spring gets K' of theory section 4 by the measured delay of the loop, so that the hand feels
the stiffness asked for (docs/decisions/0012-measured-delay.md).

The settings' estimate holds for the first second. Then the goal is that of the running median of the loop, once two readings
in a row agree; the aim moves towards it by a factor of e in FOLLOW_S, too slowly to be felt as a jerk. The world pays for a
growing stiffness. Where K is out of reach, K C_line >= 1, the goal is MOST_GAIN K: the hand feels what the line allows but
for 1 %.
"""

from cogrip.protocol.laws.felt_stiffness import enough_impedance, reachable_stiffness
from cogrip.protocol.line.loop_meter import LoopMeter
from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.seat import SeatSettings

FOLLOW_S = 1.0
READINGS_HZ = 4
REPORTS, REPORT_EVERY_S = 4, 60
AGREED_FRAMES = 0.25  # largest difference of two readings of the loop that agree
ALIKE = 1e-6  # least relative change of the goal that counts


class StiffnessAdapter:
    """Call `update` once a frame.

    reached   whether the stiffness asked for is within reach
    reported  text for people, "" none; withheld: changes that are not reported at once. The reader sets both back.
    """

    __slots__ = (
        "_aim", "_every", "_frames", "_goal", "_grows", "_last_report", "_loops", "_report_every", "_reports", "_seat", "_seen",
        "_used", "reached", "reported", "withheld",
    )  # fmt: skip

    def __init__(self, seat: SeatSettings, loops: LoopMeter) -> None:
        self._seat = seat
        self._loops = loops
        self._aim = self._goal = seat.rendered_npm
        self._grows = 1.0 + seat.rates.frame_s / FOLLOW_S
        self._every = max(1, seat.rates.network_hz // READINGS_HZ)
        self._frames = 0
        self._seen: float | None = None  # loop at the last reading
        self._used: float | None = None  # loop of the goal
        self._reports = REPORTS  # that may be made now
        self._report_every = REPORT_EVERY_S * seat.rates.network_hz
        self._last_report = True  # `reached` as it was reported last
        self.reached = True
        self.reported = ""
        self.withheld = 0

    def use_impedance(self, impedance_nspm: float) -> None:
        """Go by this impedance of the line, which is its client's choice, from now on."""
        if impedance_nspm != self._seat.coupling.impedance_nspm:
            self._seat = self._seat.at_impedance(impedance_nspm)
            self._goal, self._used = self._seat.rendered_npm, None

    def use_stiffness(self, stiffness_npm: float) -> None:
        """Aim at what makes the hand feel this stiffness, from now on."""
        self._seat = self._seat.changed(HandChange(stiffness_npm=stiffness_npm))
        self._goal, self._used = self._seat.rendered_npm, None

    def update(self) -> float | None:
        """Return the stiffness to aim at from now on [N/m]; None if nothing changes."""
        self._frames += 1
        if self._frames % self._report_every == 0 and self._reports < REPORTS:
            self._reports += 1
            self._report()
        if self._frames % self._every == 0 and self._loops.full:
            self._read_loop()
        aim, goal = self._aim, self._goal
        if aim == goal:
            return None
        self._aim = min(goal, aim * self._grows) if aim < goal else max(goal, aim / self._grows)
        return self._aim

    def _read_loop(self) -> None:
        loop, before = self._loops.median(), self._seen
        self._seen = loop
        if loop is None or before is None or abs(loop - before) > AGREED_FRAMES or loop == self._used:
            return
        self._used = loop
        seat, coupling = self._seat, self._seat.coupling
        compliance = seat.line_compliance(loop)
        goal = reachable_stiffness(coupling.stiffness_npm, compliance)
        if abs(goal - self._goal) > ALIKE * self._goal:
            self._goal = goal
        reached = coupling.stiffness_npm * compliance < 1.0
        if reached is not self.reached:
            self.reached = reached
            self.withheld += not self._reports
            self._report()

    def _report(self) -> None:
        """Report what holds now, where something else was reported last and the budget allows."""
        if self._reports and self._used is not None and self.reached is not self._last_report:
            self._reports -= 1
            self._last_report = self.reached
            self.reported = self._text(self._used)

    def _text(self, loop: float) -> str:
        coupling, compliance_mpn = self._seat.coupling, self._seat.line_compliance(loop)
        wanted = f"a felt stiffness of {coupling.stiffness_npm:g} N/m is"
        by = f"by the delay now measured ({(loop - 1) * self._seat.rates.frame_s * 1e3:.0f} ms both ways together)"
        if self.reached:
            return f"{wanted} within reach again {by}"
        enough = enough_impedance(coupling.stiffness_npm, coupling.impedance_nspm, compliance_mpn)
        return (
            f"{wanted} out of reach {by}: the line alone is as soft as {1.0 / compliance_mpn:.4g} N/m, and that is what is "
            f"felt; a coupling.impedance_nspm above {enough:.4g} would do"
        )
