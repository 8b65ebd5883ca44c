"""Which stiffness a seat's spring is to have, so that the hand feels the one that was asked for: K' of theory section 4, by
the loop as it is measured (docs/decisions/0012-measured-delay.md).

The estimate that the settings give stands until a second of the line has been heard. From then on the goal follows the
running median of the loop, once two looks in a row agree; the aim moves towards the goal by a factor of e in FOLLOW_S, slowly
enough for a hand not to feel a knock. What the spring may spend on growing stiffer is the world's affair. Where K is out of
reach, K C_line >= 1, the goal is MOST_GAIN K, with which the hand feels what the line allows but for 1 %.
"""

from cogrip.protocol.felt_stiffness import enough_impedance, reachable_stiffness
from cogrip.protocol.loop_meter import LoopMeter
from cogrip.protocol.settings import SeatSettings

FOLLOW_S = 1.0
LOOKS_HZ = 4
WORDS, WORD_EVERY_S = 4, 60
ALIKE = 1e-6  # a goal that differs by less from the aim is the aim


class StiffnessAdapter:
    """`update` once a frame. `reported` is what people should hear of, `withheld` how many changes they do not hear of at
    once: taken by setting them back."""

    __slots__ = (
        "_aim", "_every", "_frames", "_goal", "_grows", "_heard", "_loops", "_seat", "_seen", "_used", "_words",
        "_words_every", "reached", "reported", "withheld",
    )  # fmt: skip

    def __init__(self, seat: SeatSettings, loops: LoopMeter) -> None:
        self._seat = seat
        self._loops = loops
        self._aim = self._goal = seat.rendered_npm
        self._grows = 1.0 + seat.rates.frame_s / FOLLOW_S
        self._every = max(1, seat.rates.network_hz // LOOKS_HZ)
        self._frames = 0
        self._seen: int | None = None  # loop at the last look
        self._used: int | None = None  # loop that the goal is for
        self._words = WORDS  # that may be said now
        self._words_every = WORD_EVERY_S * seat.rates.network_hz
        self._heard = True  # `reached` as people heard it last
        self.reached = True
        self.reported = ""
        self.withheld = 0

    def update(self) -> float | None:
        """The stiffness to aim at from now on [N/m], None if nothing changes."""
        self._frames += 1
        if self._frames % self._words_every == 0 and self._words < WORDS:
            self._words += 1
            self._say()
        if self._frames % self._every == 0 and self._loops.full:
            self._look()
        aim, goal = self._aim, self._goal
        if aim == goal:
            return None
        self._aim = min(goal, aim * self._grows) if aim < goal else max(goal, aim / self._grows)
        return self._aim

    def _look(self) -> None:
        loop, before = self._loops.median(), self._seen
        self._seen = loop
        if loop is None or loop != before or loop == self._used:
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
            self.withheld += not self._words
            self._say()

    def _say(self) -> None:
        """What holds now, where people have heard something else and a word is left."""
        if self._words and self._used is not None and self.reached is not self._heard:
            self._words -= 1
            self._heard = self.reached
            self.reported = self._text(self._used)

    def _text(self, loop: int) -> str:
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
