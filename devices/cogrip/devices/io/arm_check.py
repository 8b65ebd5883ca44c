"""Measures an arm for `arm.check`: small currents, one axis after the other, zero between and after, whatever happens."""

import time
from collections.abc import Callable, Sequence

from cogrip.devices.arm.check import ArmFindings
from cogrip.devices.arm.exchange import Reading, RequestExchange, meet
from cogrip.devices.device import DeviceError

MOST_TEST_MA = 200.0
STEP_S = 0.001
RAMP_S = 0.1
HOLD_S = 0.15
LATE_S = 0.1  # longest wait for a late reply: one that has not come by then never will
ENOUGH_COUNTS = 60  # motion at which the arm has moved for sure: no need to push on
ZERO = (0.0, 0.0, 0.0)
_JOINTS = 3


class ArmCheck:
    """One arm that nobody holds. The line is open between `begin` and `end`."""

    def __init__(self, exchange: RequestExchange, current_ma: float) -> None:
        if not 0.0 < current_ma <= MOST_TEST_MA:
            raise DeviceError(f"test current {current_ma:g} mA is out of 0 to {MOST_TEST_MA:g}")
        self._exchange = exchange
        self._current_ma = current_ma
        self._requests = self._missed = 0
        self._most_moved = list(range(_JOINTS))  # encoder that each motor moves most
        self._low: list[int] = []
        self._high: list[int] = []

    def begin(self) -> Reading:
        line = self._exchange.line
        line.open()
        try:
            reading = meet(self._exchange, ZERO)
        except DeviceError:
            line.close()
            raise
        self._seen(reading)
        return reading

    def end(self) -> None:
        """Zero, twice, and let go."""
        line, codec = self._exchange.line, self._exchange.codec
        try:
            for _ in range(2):
                line.read(0.02)
                line.write(codec.encode(ZERO))
        except DeviceError:
            pass  # it is lost: its own watchdog lets go
        finally:
            line.close()

    def _ask(self, currents: Sequence[float], wait_s: float = 0.02) -> Reading | None:
        """One request, one reply."""
        line, codec = self._exchange.line, self._exchange.codec
        self._requests += 1
        line.write(codec.encode(currents))
        until_s = time.perf_counter() + wait_s
        while (rest_s := until_s - time.perf_counter()) > 0.0:
            readings = codec.feed(line.read(rest_s))
            if readings and not readings[-1].rejected:
                self._seen(readings[-1])
                return readings[-1]
            if readings:  # its counts are old
                break
        else:
            line.read(LATE_S)  # else a late reply would be taken for the next one's
        self._missed += 1
        codec.reset()
        return None

    def _seen(self, reading: Reading) -> None:
        counts = [round(value) for value in reading.raw]
        self._low = [min(pair) for pair in zip(self._low or counts, counts, strict=True)]
        self._high = [max(pair) for pair in zip(self._high or counts, counts, strict=True)]

    def _paced(self, seconds: float, currents: Callable[[float], Sequence[float]]) -> list[Reading]:
        """Requests every millisecond."""
        begun_s, readings = time.perf_counter(), []
        for step in range(round(seconds / STEP_S)):
            reading = self._ask(currents(step * STEP_S))
            if reading is not None:
                readings.append(reading)
            rest_s = begun_s + (step + 1) * STEP_S - time.perf_counter()
            if rest_s > 0.0:
                time.sleep(rest_s)
        return readings

    def speed(self, requests: int = 1000) -> tuple[float, list[float]]:
        """Rate [Hz] of requests one after the other, and each one's latency [us], sorted."""
        latencies = []
        begun_s = time.perf_counter()
        for _ in range(requests):
            asked_s = time.perf_counter()
            if self._ask(ZERO) is not None:
                latencies.append(1e6 * (time.perf_counter() - asked_s))
        rate_hz = requests / (time.perf_counter() - begun_s)
        if not latencies:
            raise DeviceError(f"{self._exchange.line.name}: answered none of {requests} requests")
        return rate_hz, sorted(latencies)

    def noise(self, seconds: float = 0.5) -> tuple[int, ...]:
        readings = self._paced(seconds, lambda _: ZERO)
        columns = list(zip(*[reading.raw for reading in readings], strict=True))
        return tuple(round(max(column) - min(column)) for column in columns) or (0,) * _JOINTS

    def push(self, joint: int, sense: float) -> int:
        """Return how far [counts] a small current moves a joint. It is ramped in, and ends as soon as the joint moves."""
        start = self._ask(ZERO)
        moved = most = 0

        def current(at_s: float) -> Sequence[float]:
            fraction = 0.0 if most >= ENOUGH_COUNTS else min(1.0, at_s / RAMP_S)
            return tuple(sense * fraction * self._current_ma if axis == joint else 0.0 for axis in range(_JOINTS))

        begun_s = time.perf_counter()
        while (at_s := time.perf_counter() - begun_s) < RAMP_S + HOLD_S and most < ENOUGH_COUNTS:
            readings = self._paced(5 * STEP_S, lambda _, at_s=at_s: current(at_s))  # type: ignore[misc]
            if readings and start is not None:
                all_moved = [round(now - then) for now, then in zip(readings[-1].raw, start.raw, strict=True)]
                moved, most = all_moved[joint], max(map(abs, all_moved))
                self._most_moved[joint] = max(range(_JOINTS), key=lambda each: (abs(all_moved[each]), each == joint))
        self._paced(0.3, lambda _: ZERO)  # let it come to rest
        return moved

    def watch(self, seconds: float) -> None:
        """The person moves the arm; the range is noted."""
        self._paced(seconds, lambda _: ZERO)

    def measured(self, progress: Callable[[str], None], moving_s: float) -> ArmFindings:
        """All of it. `progress` says what comes next."""
        progress("rate and latency")
        rate_hz, latencies = self.speed()
        progress("noise at rest: do not touch the arm")
        noise = self.noise()
        forward, backward = [], []
        for joint in range(_JOINTS):
            progress(f"axis {'abc'[joint]} under {self._current_ma:g} mA: do not touch the arm")
            forward.append(self.push(joint, 1.0))
            backward.append(self.push(joint, -1.0))
        if moving_s > 0.0:
            progress(f"now move the arm through its whole range, for {moving_s:g} s")
            self.watch(moving_s)
        return ArmFindings(
            self._requests, self._missed, rate_hz, latencies[len(latencies) // 2], latencies[int(0.99 * len(latencies))],
            noise, tuple(forward), tuple(backward), tuple(self._low), tuple(self._high),
            tuple(self._most_moved),
        )  # fmt: skip
