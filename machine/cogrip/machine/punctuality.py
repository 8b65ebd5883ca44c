"""Punctuality of this machine: timer lateness with and without each real-time measure, permissions, advice.

Every lateness is measured in a fresh child process, so that no measure leaks into the next and the caller stays
ordinary. The child's tick does a stand-in for work: some floats, and short-lived objects for the garbage collector.
"""

import json
import math
import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import get_clock_info
from timeit import timeit

from cogrip.machine import realtime
from cogrip.machine.histogram import DurationHistogram
from cogrip.machine.large_pages import large_pages_permission
from cogrip.machine.pacing import SPIN_NS, Pacer
from cogrip.machine.platform import system, time

_MODULE = "cogrip.machine.punctuality"  # name of this module; __name__ may be __main__

RATES_HZ = (1024, 4096, 8192)
PLAIN, ALL = "plain sleep", "all together"
SETUPS: dict[str, tuple[tuple[str, ...], int]] = {
    PLAIN: ((), 0),
    "+ timer slack 1 ns": (("timer-slack",), 0),
    f"+ spin {SPIN_NS // 1000} us": ((), SPIN_NS),
    "+ gc frozen": (("gc-frozen",), 0),
    "+ memory locked": (("memory-locked",), 0),
    "+ CPUs awake": (("cpu-awake",), 0),
    "+ SCHED_FIFO": (("fifo",), 0),
    ALL: (realtime.NAMES, SPIN_NS),
}
"""Name -> (real-time measures, spin in ns)."""


@dataclass(frozen=True, slots=True)
class Punctuality:
    """Ticks of one child process: durations in us by percentile, refusals by measure."""

    rate_hz: int
    setup: str
    due: int
    skipped: int
    lateness_us: dict[str, float]
    work_us: dict[str, float]
    refused: dict[str, str]

    @property
    def skipped_share(self) -> float:
        """Skipped ticks / due ticks."""
        return self.skipped / self.due if self.due else math.nan

    @property
    def verdict(self) -> str:
        """`in reach`: p99 within a quarter period and at most 0.1 % skipped; `marginal`: within one period and 1 %."""
        period_us, p99_us = 1e6 / self.rate_hz, self.lateness_us["p99"]
        if p99_us <= period_us / 4 and self.skipped_share <= 0.001:
            return "in reach"
        return "marginal" if p99_us <= period_us and self.skipped_share <= 0.01 else "out of reach"


@dataclass(frozen=True, slots=True)
class MachineState:
    """Settings and permissions of the machine; None where one cannot be read."""

    kernel: str
    preemption: str | None
    cpus: int
    usable_cpus: int
    virtual: bool | None
    governor: str | None
    clock_source: str | None
    clock_resolution_ns: float
    clock_read_ns: float
    load_1min: float | None
    fifo_permission: str  # "yes, ..." or "no, ..." and by what
    lock_permission: str
    large_pages: str
    loopback_us: dict[str, float] | None
    lacks: dict[str, str]  # what this system lacks of what Linux has, and what is there instead
    load_after: float | None = None  # the same mean load when all was measured; the measuring itself is up to 1 of it

    @property
    def busy(self) -> float | None:
        """Return the load average under which was measured, None on a machine that had nothing else to do."""
        loads = [(self.load_1min, 0.5 * self.usable_cpus), (self.load_after, 0.5 * self.usable_cpus + 1.0)]
        return max((load for load, most in loads if load is not None and load > most), default=None)


def _tick_work(kept: list[object], tick: int) -> None:
    """Do the work of a client's tick: some float arithmetic and some objects, of which the last 256 ticks' survive."""
    x = float(tick)
    for _ in range(24):
        x = 0.5 * x + 1.0
    kept[tick & 255] = [x, [x, [x]]]


def observe(rate_hz: int, names: Sequence[str], seconds: float, spin_ns: int, setup: str = "") -> Punctuality:
    """Run ticks for `seconds` in this thread under the named measures."""
    measures = realtime.engage(names)
    kept: list[object] = [None] * 256
    try:
        pacer = Pacer(rate_hz, time.monotonic_ns() + 2_000_000, spin_ns=spin_ns)
        tick, last = -1, int(seconds * rate_hz) - 1
        while tick < last:
            tick = pacer.wait()
            _tick_work(kept, tick)
            pacer.done()
    finally:
        realtime.release(measures)
    refused = {measure.name: measure.detail for measure in measures if not measure.granted}
    lateness_us, work_us = pacer.lateness.summary_us(), pacer.work.summary_us()
    return Punctuality(rate_hz, setup, pacer.due, pacer.skipped, lateness_us, work_us, refused)


def measure(rate_hz: int, setup: str, seconds: float) -> Punctuality:
    """`observe` for a setup of SETUPS in a fresh child process. Raises RuntimeError with its output when it fails."""
    names, spin_ns = SETUPS[setup]
    command = [sys.executable, "-P", "-m", _MODULE]
    command += [str(rate_hz), ",".join(names), str(seconds), str(spin_ns), setup]
    child = subprocess.run(command, capture_output=True, text=True, timeout=60.0 + 4.0 * seconds, check=False)
    if child.returncode:
        raise RuntimeError(f"measuring {setup!r} at {rate_hz} Hz ended with {child.returncode}: {child.stderr.strip()}")
    return Punctuality(**json.loads(child.stdout))


def survey(seconds: float, rates_hz: Sequence[int] = RATES_HZ) -> Iterator[Punctuality]:
    """Measure every rate with every setup, one after another."""
    for rate_hz in rates_hz:
        for setup in SETUPS:
            yield measure(rate_hz, setup, seconds)


def loopback_us(rounds: int = 2000) -> dict[str, float] | None:
    """Return UDP round trips over 127.0.0.1 in us, both ends in this thread; None where the network refuses.

    A trip is four system calls and the kernel's path twice.
    """
    trips = DurationHistogram()
    try:
        with socket.socket(type=socket.SOCK_DGRAM) as near, socket.socket(type=socket.SOCK_DGRAM) as far:
            for end in (near, far):
                end.bind(("127.0.0.1", 0))
                end.settimeout(1.0)
            near.connect(far.getsockname())
            far.connect(near.getsockname())
            for _ in range(rounds):
                start_ns = time.monotonic_ns()
                near.send(bytes(200))
                far.send(far.recv(2048))
                near.recv(2048)
                trips.add(time.monotonic_ns() - start_ns)
    except OSError:
        return None
    return trips.summary_us()


def _read(path: str) -> str | None:
    """Return a one-line file's text; None when it is missing, refused or empty."""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace").strip() or None
    except OSError:
        return None


def _preemption(version: str) -> str | None:
    """Return the kernel's preemption model, from uname's version and, where readable, the scheduler's switch."""
    if _read("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in version:
        return "PREEMPT_RT"
    chosen = _read("/sys/kernel/debug/sched/preempt")  # "none voluntary (full)"
    if chosen and "(" in chosen:
        return f"dynamic, now {chosen[chosen.index('(') + 1 : chosen.index(')')]}"
    return next((model for model in ("PREEMPT_DYNAMIC", "PREEMPT") if model in version), None)


def _virtual() -> bool | None:
    """Return whether the processor is a virtual machine's; None where that cannot be read."""
    text = _read("/proc/cpuinfo")
    if text is None or "flags" not in text:
        return None
    return any("hypervisor" in line.split() for line in text.splitlines() if line.startswith("flags"))


def _clock_read_ns() -> float:
    """Return the mean cost of reading the clock in ns."""
    return timeit(time.monotonic_ns, number=10_000) * 1e5


def _permissions() -> tuple[str, str]:
    """Return whether SCHED_FIFO and locked memory are allowed, and by what, without trying either."""
    if sys.platform != "linux":
        return _fifo_permission(), "no, only used on Linux"
    import resource

    def permission(capability: int, limit: str, most: int, granted: bool, shown: str) -> str:
        if realtime.has_capability(capability):
            return "yes, by capability"
        if most == resource.RLIM_INFINITY:
            return f"yes, {limit} limit unlimited"
        return f"{'yes' if granted else 'no'}, {limit} limit {shown}"

    rtprio, memlock = resource.getrlimit(resource.RLIMIT_RTPRIO)[0], resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
    fifo = permission(realtime.CAP_SYS_NICE, "rtprio", rtprio, rtprio >= realtime.PRIORITY, str(rtprio))
    return fifo, permission(realtime.CAP_IPC_LOCK, "memlock", memlock, False, f"{memlock // 1024} KiB")


def _fifo_permission() -> str:
    """Return what stands for SCHED_FIFO where this is not Linux."""
    return f"yes, as {system.LACKS['SCHED_FIFO']}" if "fifo" in system.REAL_TIME else "no, only used on Linux"


def _load() -> float | None:
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


def examine() -> MachineState:
    """Read the machine's settings and this user's permissions; change nothing."""
    kernel = os.uname() if hasattr(os, "uname") else None
    fifo, lock = _permissions()
    return MachineState(
        kernel=f"{kernel.sysname} {kernel.release} {kernel.machine}" if kernel else sys.platform,
        preemption=_preemption(kernel.version) if kernel else None,
        cpus=os.cpu_count() or 1,
        usable_cpus=system.usable_cpus(),
        virtual=_virtual(),
        governor=_read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
        clock_source=_read("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        clock_resolution_ns=get_clock_info(system.CLOCK).resolution * 1e9,
        clock_read_ns=_clock_read_ns(),
        load_1min=_load(),
        fifo_permission=fifo,
        lock_permission=lock,
        large_pages=large_pages_permission(),
        loopback_us=loopback_us(),
        lacks=system.LACKS,
    )


def after(machine: MachineState) -> MachineState:
    """Return `machine` with the load at the end of a survey."""
    return replace(machine, load_after=_load())


WORDS = ("in reach", "marginal", "out of reach")


def verdicts(found: Sequence[Punctuality]) -> dict[int, str]:
    """Return the word for each rate with all measures together: never better than that of a slower rate."""
    words: dict[int, str] = {}
    worst = 0
    for each in sorted((each for each in found if each.setup == ALL), key=lambda each: each.rate_hz):
        worst = max(worst, WORDS.index(each.verdict))
        words[each.rate_hz] = WORDS[worst]
    return words


def advise(machine: MachineState, found: Sequence[Punctuality]) -> list[str]:
    """Return advice, the most useful first."""
    advice: list[str] = []
    refused = {name: why for each in found for name, why in each.refused.items()}
    if any(why.startswith("refused") for why in refused.values()):
        advice.append(
            f"Grant real time to yourself: as root write two lines into {realtime.LIMITS_FILE}: "
            f"'<user> - rtprio {realtime.PRIORITY}' and '<user> - memlock unlimited'; then log out and in again."
        )
    advice += [f"{name} is {why}." for name, why in refused.items() if why.startswith("not available")]
    together = {each.rate_hz: each for each in found if each.setup == ALL}
    plain = {each.rate_hz: each for each in found if each.setup == PLAIN}
    words, busy = verdicts(found), machine.busy
    under = "" if busy is None else f", measured under load (load average {busy:.1f})"
    for rate_hz, each in sorted(together.items()):
        word = words[rate_hz]
        late = f"p99 {each.lateness_us['p99']:.0f} us, period {1e6 / rate_hz:.0f} us, {each.skipped_share:.2%} skipped{under}"
        if word != each.verdict:
            advice.append(f"{rate_hz} Hz is {word}, as a slower rate is, though it came in time itself ({late}).")
        elif word == "in reach":
            bare = plain.get(rate_hz)
            also = "" if bare is None or bare.verdict == word else "; plain sleep is not enough"
            advice.append(f"{rate_hz} Hz is in reach with every measure granted here ({late}){also}.")
        elif busy is not None:
            advice.append(f"{rate_hz} Hz was {word} ({late}): what a quiet machine reaches is not known by this.")
        elif word == "marginal":
            advice.append(f"{rate_hz} Hz is marginal ({late}): expect late ticks, and stay below this device rate.")
        else:
            advice.append(f"{rate_hz} Hz is out of reach here ({late}): choose a lower device rate.")
    if machine.usable_cpus < 2:
        advice.append("Only one processor is usable: a spinning loop starves everything else; use spin_ns = 0.")
    if machine.governor not in (None, "performance"):
        advice.append(
            f"The processor's governor is {machine.governor!r}: 'cpupower frequency-set -g performance' as root "
            "removes the slow start of every tick."
        )
    if machine.virtual:
        advice.append(
            "This is a virtual machine: its host adds lateness that nothing here removes; use bare metal for force."
        )
    if system.LINUX and machine.preemption != "PREEMPT_RT" and any(word != "in reach" for word in words.values()):
        advice.append("A PREEMPT_RT kernel (Debian: linux-image-rt-amd64) shortens the longest latenesses.")
    if busy is not None:
        advice.append(
            f"The machine was busy (load average {busy:.1f} on {machine.usable_cpus} processors): measure again when it is "
            "quiet, before a device rate is chosen by this."
        )
    return advice


def _main(arguments: Sequence[str]) -> int:
    """Print one Punctuality as JSON: the child process."""
    rate_hz, names, seconds, spin_ns, setup = arguments
    try:
        found = observe(int(rate_hz), [n for n in names.split(",") if n], float(seconds), int(spin_ns), setup)
    except KeyboardInterrupt:
        return 130
    print(json.dumps(asdict(found)))
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1:]))
