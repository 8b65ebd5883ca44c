"""Functions of the operating system: `system`, which is `posix` or `windows`, and `time`, whose clock is fine enough for ticks.

Both modules have the same names, so that nothing else asks on which system it runs. What Windows has instead:

    file locks (flock)              LockFileEx on one byte far beyond the end; a child locks for itself
    descriptors handed to a child   inherited handles, named by number
    a session of its own (setsid)   a process group of its own, which Ctrl-C does not reach
    SIGINT, SIGTERM to a child      CTRL_BREAK_EVENT, which arrives as SIGBREAK; SIGHUP and SIGUSR1: none
    a typed line without waiting    the keys of the console (msvcrt.kbhit)
    a local pair of sockets         two UDP sockets on loopback, connected to each other
    time.monotonic                  time.perf_counter (QueryPerformanceCounter)
    timer slack, SCHED_FIFO         timeBeginPeriod(1); HIGH_PRIORITY_CLASS and THREAD_PRIORITY_TIME_CRITICAL
    mlockall, /dev/cpu_dma_latency, SO_TIMESTAMPNS, SO_MEMINFO: none
"""

import sys

if sys.platform == "win32":
    from cogrip.machine import windows as system
    from cogrip.machine.windows import time
else:
    import time

    from cogrip.machine import posix as system

__all__ = ["system", "time"]
