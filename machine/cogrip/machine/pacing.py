"""Ticks at absolute deadlines: tick k is due at t0 + k * 10**9 // rate_hz, whatever happened before.

Waiting sleeps to shortly before the deadline and spins the rest: the kernel wakes a sleeper tens of microseconds late. No more
than a part of a period is spun (SPIN_PART): others of lower priority need the processor, too.
Overrun policy: a tick up to one period late still runs, and the next follows at once. Later than that, the pacer
skips to the newest tick that is due and counts what it skipped. due = run + skipped, always.

`lateness` counts from the deadline the pacer was waiting for, before any skip: counted from the tick it skips to, no
lateness could ever exceed a period. `late_ns` is the last tick's own.
"""

from collections.abc import Callable

from cogrip.machine.histogram import DurationHistogram
from cogrip.machine.platform import system, time
from cogrip.machine.tick_count import Percentiles, TickCount

SPIN_NS, SPIN_PART = system.SPIN_NS, system.SPIN_PART


class Pacer:
    """Deadlines of one loop or room at rate_hz, counted from t0_ns on `clock` (ns); `sleep` takes seconds.

    Either call `wait()`, or, with several pacers in one thread, sleep to the smallest `next_due_ns` (of the next tick) and
    `take(now)`. started_ns: when the newest tick began.
    """

    __slots__ = (
        "_busy", "_clock", "_next", "_sleep", "late_ns", "lateness", "next_due_ns", "rate_hz", "run", "skipped", "spin_ns",
        "started_ns", "t0_ns", "work",
    )  # fmt: skip

    def __init__(
        self, rate_hz: int, t0_ns: int, *, first: int = 0, spin_ns: int = SPIN_NS,
        clock: Callable[[], int] = time.monotonic_ns, sleep: Callable[[float], object] = time.sleep,
    ) -> None:  # fmt: skip
        """`first` is the first tick to run: tick_at(now) + 1 joins a timeline already under way without skips."""
        if rate_hz < 1:
            raise ValueError(f"rate_hz {rate_hz} is below 1: give whole ticks a second")
        if spin_ns < 0:
            raise ValueError(f"spin_ns {spin_ns} is negative: give 0 to sleep only")
        self.rate_hz, self.t0_ns = rate_hz, t0_ns
        self.spin_ns = min(spin_ns, 1_000_000_000 // (SPIN_PART * rate_hz))
        self.run = self.skipped = self.late_ns = 0
        self.lateness, self.work = DurationHistogram(), DurationHistogram()
        self._clock, self._sleep, self._next = clock, sleep, first
        self.next_due_ns = self.due_ns(first)
        self.started_ns, self._busy = 0, False

    def due_ns(self, tick: int) -> int:
        """Return the due time of a tick, in ns of the clock."""
        seconds, rest = divmod(tick, self.rate_hz)  # so that no product needs more than 64 bits, for 292 years
        return self.t0_ns + seconds * 1_000_000_000 + rest * 1_000_000_000 // self.rate_hz

    def tick_at(self, now_ns: int) -> int:
        """Return the newest tick due at now_ns: the largest k with due_ns(k) <= now_ns; negative before t0."""
        seconds, rest_ns = divmod(now_ns - self.t0_ns, 1_000_000_000)
        return seconds * self.rate_hz + ((rest_ns + 1) * self.rate_hz - 1) // 1_000_000_000

    @property
    def due(self) -> int:
        """Ticks that were due so far: run + skipped."""
        return self.run + self.skipped

    def take(self, now_ns: int) -> int | None:
        """Return the tick to run at now_ns, None when none is due yet. Applies the overrun policy, starts `work`."""
        if now_ns < self.next_due_ns:
            return None
        tick = self._next
        following_ns = self.due_ns(tick + 1)
        self.lateness.add(now_ns - self.next_due_ns)
        if now_ns > following_ns:  # more than one period late
            newest = self.tick_at(now_ns)
            self.skipped += newest - tick
            tick = newest
            self.next_due_ns = self.due_ns(tick)
            following_ns = self.due_ns(tick + 1)
        self.late_ns = now_ns - self.next_due_ns
        self.run += 1
        self._next = tick + 1
        self.next_due_ns = following_ns
        self.started_ns, self._busy = now_ns, True
        return tick

    def pass_by(self, now_ns: int) -> int:
        """Count the ticks that are due as run, without lateness and work: of a room where nobody is. Returns how many."""
        count = max(0, self.tick_at(now_ns) + 1 - self._next)
        self.run += count
        self._next += count
        self.next_due_ns = self.due_ns(self._next)
        return count

    def wait(self) -> int:
        """Sleep, then spin, to the next deadline and return its tick; return at once when it is late already."""
        clock = self._clock
        deadline_ns = self.next_due_ns
        now_ns = clock()
        while now_ns < deadline_ns:
            remaining_ns = deadline_ns - self.spin_ns - now_ns
            if remaining_ns > 0:
                self._sleep(remaining_ns * 1e-9)
            now_ns = clock()
        tick = self.take(now_ns)
        assert tick is not None
        return tick

    def done(self, early_ns: int = 0) -> None:
        """Mark the end of the tick's work; time since the tick started goes into `work`. A second call adds none.

        early_ns: what was done ahead of the tick, which goes into `work`, too.
        """
        self.done_at(self._clock(), early_ns)

    def done_at(self, now_ns: int, early_ns: int) -> None:
        """Do what `done` does, now being known."""
        if self._busy:
            self.work.add(now_ns - self.started_ns + early_ns)
            self._busy = False

    def count(self) -> TickCount:
        """Return the account of the ticks so far, in us."""
        return TickCount(self.due, self.run, Percentiles.of(self.lateness, 1e3), Percentiles.of(self.work, 1e3))
