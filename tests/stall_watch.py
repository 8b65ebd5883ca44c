"""Sleeps for 5 ms at a time and tells when it awoke too late; ends its parent where a test hangs. A script of its own.

On standard input come limits [s], one a test and line: of time as the machine gives it (`fair_time`). At the end of the input
it ends. On standard output go stalls longer than its argument [s].
"""

import os
import select
import signal
import sys
import time

from fair_time import FairTime

LOOK_S, COUNT_S = 0.005, 1.0


def main(stall_s: float) -> None:
    parent, limit_s, given = os.getppid(), float("inf"), FairTime()
    last_s = counted_s = time.monotonic()
    while True:
        told = os.read(0, 65536) if select.select([0], [], [], LOOK_S)[0] else None
        now_s = time.monotonic()
        if now_s - last_s > stall_s:
            os.write(1, b"%.3f " % (now_s - last_s))
        last_s = now_s
        if told == b"":
            return
        if told:
            limit_s, given = float(told.split()[-1]), FairTime()
        if now_s - counted_s > COUNT_S:
            counted_s = now_s
            if given.spent_s() > limit_s:
                os.kill(parent, signal.SIGABRT)  # pytest's faulthandler then shows where every thread is
                limit_s = float("inf")


if __name__ == "__main__":
    main(float(sys.argv[1]))
