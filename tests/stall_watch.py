"""Sleeps for some ms at a time and knows when it awoke too late; ends its parent where a test hangs. A script of its own.

On standard input come lines: a limit [s] as each test begins, of time as the machine gives it (`fair_time`); an exclamation
mark as something begins that a stall may harm, from where on it sleeps for 5 ms at a time until the next test; a question
mark. The answer to that, on standard output: the longest that it overslept since the mark [s], and since the test began the
mean share of a processor that those had who wanted one. At the end of the input it ends.
"""

import os
import select
import signal
import time

from fair_time import FairTime, share

LOOK_S, COUNT_S, IDLE_S = 0.005, 0.05, 0.25


def main() -> None:
    parent, limit_s, given = os.getppid(), float("inf"), FairTime()
    last_s = counted_s = begun_s = time.monotonic()
    longest_s, look_s = 0.0, IDLE_S
    while True:
        told = os.read(0, 65536) if select.select([0], [], [], look_s)[0] else None
        now_s = time.monotonic()
        longest_s, last_s = max(longest_s, now_s - last_s - look_s), now_s
        if told == b"":
            return
        for line in (told or b"").split():
            if line == b"?":
                mean = given.spent_s() / (now_s - begun_s) if now_s > begun_s else share()
                os.write(1, b"%.3f %.2f\n" % (longest_s, min(1.0, mean)))
            elif line == b"!":
                look_s, longest_s = LOOK_S, longest_s if look_s == LOOK_S else 0.0
            else:
                limit_s, given, begun_s = float(line), FairTime(), now_s
                longest_s, look_s = 0.0, IDLE_S
        if now_s - counted_s > COUNT_S:
            counted_s = now_s
            if given.spent_s() > limit_s:
                os.kill(parent, signal.SIGABRT)  # pytest's faulthandler then shows where every thread is
                limit_s = float("inf")


if __name__ == "__main__":
    main()
