"""The live loop with defects and impossible settings: the hand is released softly, and the error is reported."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import pytest

from cogrip.client import loop
from cogrip.client.inputs import Connect
from cogrip.client.io.paths import JoinError
from cogrip.client.loop import Ended, LiveClient, fade_out
from cogrip.client.safety.limiter import FAULT_OUT_S
from cogrip.devices.device import DeviceError, Sample
from cogrip.machine import pacing
from cogrip.machine.pacing import Pacer
from cogrip.machine.stop import Stop
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Leave
from cogrip.sim.link import LinkEmulator

from tests.client.seated_client import DEVICE_HZ, capability, hello, seat, welcome

TICKS = round(FAULT_OUT_S * DEVICE_HZ)


class VirtualTime:
    """A clock that goes on while somebody waits for it."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.starved_ns = 0  # of it without a processor

    def monotonic_ns(self) -> int:
        return self.now_ns

    time_ns = monotonic_ns

    def sleep(self, seconds: float) -> None:
        self.now_ns += max(1, round(seconds * 1e9))

    def starve(self, seconds: float) -> None:
        """Let others have the processor for some time."""
        self.sleep(seconds)
        self.starved_ns += round(seconds * 1e9)

    def pacer(self, rate_hz: int, t0_ns: int) -> Pacer:
        return Pacer(rate_hz, t0_ns, clock=self.monotonic_ns, sleep=self.sleep, spin_ns=0)


class Moving:
    """A hand that moves on evenly: a damper's force. `breaks` as it is read, `written` as it is written; notes its forces."""

    def __init__(self, breaks: Callable[[int], None] = lambda tick: None) -> None:
        self.capability, self.breaks = capability(), breaks
        self.written: Callable[[], None] = lambda: None
        self.counts: dict[str, int] = {}
        self.did: list[str] = []
        self.forces: list[float] = []

    def open(self, rate_hz: int) -> None:
        self.did.append("open")

    def read(self, tick: int) -> Sample:
        self.breaks(tick)
        return Sample((0.1 * tick / DEVICE_HZ,), (0.1,))

    def write(self, force_n: Sequence[float]) -> None:
        self.written()
        self.forces.append(force_n[0])

    def close(self) -> None:
        self.did.append("close")

    @property
    def steps(self) -> list[float]:
        """Changes of the force from the 80th on."""
        return [before - after for before, after in pairwise(self.forces[79:])]


class Server:
    """Gives a seat, and receives the goodbye. Breaks the loop as it drains its socket."""

    def __init__(self, breaks: Callable[[], None] = lambda: None, **link: object) -> None:
        self.breaks, self.seat = breaks, seat(link=link)
        self.sent: list[Any] = []

    def connect(self, core: Any, stop: Stop) -> None:
        core.handle(Connect(), 0)
        core.receive(welcome(self.seat), 0)

    def send(self, message: bytes, hello: bool = False) -> None:
        self.sent.append(messages.decode(message))

    def drain(self, *_: object) -> None:
        self.breaks()

    def poll(self, *_: object, **__: object) -> None: ...

    def counted(self) -> dict[str, int]:
        return {}

    def explained(self, failed: str) -> str:
        return failed

    @property
    def goodbyes(self) -> set[str]:
        return {message.reason for message in self.sent if isinstance(message, Leave)}


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> VirtualTime:
    found = VirtualTime()
    monkeypatch.setattr(loop, "time", found)
    monkeypatch.setattr(pacing, "Pacer", found.pacer)
    monkeypatch.setattr(loop, "engage", lambda names: [])
    monkeypatch.setattr(loop, "processor_wait", lambda: lambda: found.starved_ns)
    return found


def client(device: Any, server: Any, make_link: Any = LinkEmulator) -> LiveClient:
    return LiveClient(device, hello(), server, Stop(), lambda words: None, make_link, lambda seat: None)


def ended(device: Any, server: Any = None, seconds: float | None = None) -> Ended:
    ran = client(device, server or Server())
    ran.seconds = ran.seconds if seconds is None else seconds
    found = ran.run()
    assert isinstance(found, Ended)
    return found


def fails(error: BaseException) -> Callable[[], None]:
    def raising() -> None:
        raise error

    return raising


def test_a_defect_in_the_loop_releases_the_hand_softly_before_it_is_raised(clock: VirtualTime) -> None:
    def breaks() -> None:
        if len(device.forces) == 80:
            raise RuntimeError("a defect")

    device = Moving()
    with pytest.raises(RuntimeError, match="a defect"):
        client(device, Server(breaks)).run()
    held_n = device.forces[79]
    assert held_n > 0.1, "there was a force to release"
    assert device.steps == pytest.approx([held_n / TICKS] * TICKS)
    assert device.forces[-1] == 0.0
    assert device.did == ["open", "close"]
    assert clock.now_ns == pytest.approx((80 + TICKS) / DEVICE_HZ * 1e9 + loop.LEAD_NS, rel=0.02)


def test_a_device_that_cannot_be_written_is_closed_at_once(clock: VirtualTime) -> None:
    def breaks() -> None:
        if len(device.forces) == 80:
            device.written = fails(RuntimeError("the cable is out"))
            raise RuntimeError("a defect")

    device = Moving()
    with pytest.raises(RuntimeError, match="a defect"):
        client(device, Server(breaks)).run()
    assert len(device.forces) == 80
    assert device.did == ["open", "close"]


@pytest.mark.parametrize(
    "error", [OSError(5, "Input/output error"), IndexError("list index out of range"), ValueError()]
)
@pytest.mark.parametrize("verb", ["read", "write"])
def test_whatever_a_driver_raises_is_a_fault_and_no_traceback(clock: VirtualTime, verb: str, error: Exception) -> None:
    """The force fades within the time of a fault, where the device still takes it; the server hears why; all is closed."""

    def breaks(tick: int) -> None:
        if len(device.forces) == 80:
            if verb == "read":
                raise error
            device.written = fails(error)

    device, server = Moving(breaks), Server()
    found = ended(device, server)
    assert found.failed.startswith(f"device: test: {type(error).__name__}")
    assert str(error) in found.failed
    assert found.failed.endswith(f"in {verb}; its driver has a defect: correct it, or tell its author")
    assert found.account.state == "fault", "so is the verdict"
    assert found.account.reason == found.failed
    assert server.goodbyes == {found.failed[:300]}
    assert set(device.did[1:]) == {"close"}
    if verb == "read":
        assert device.forces[79] > 0.1
        assert device.forces[80:].index(0.0) < TICKS + 1
        assert max(device.steps) <= 2.01 / TICKS, "2 N, as fast as a fault takes it"


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_an_interrupt_inside_a_driver_is_not_swallowed(clock: VirtualTime, error: type[BaseException]) -> None:
    device = Moving(lambda tick: fails(error())() if tick == 80 else None)
    with pytest.raises(error):
        client(device, Server()).run()
    assert device.did == ["open", "close"]


def test_a_driver_that_raises_as_it_is_opened_or_closed(clock: VirtualTime) -> None:
    device, server = Moving(), Server()
    device.open = device.close = lambda *_: [][0]  # type: ignore[assignment, method-assign]
    with pytest.raises(
        DeviceError, match=r"^test: IndexError: list index out of range in open; its driver has a defect"
    ):
        client(device, server).run()
    (goodbye,) = server.goodbyes
    assert goodbye.startswith("device: test: IndexError")
    device = Moving()
    device.close = lambda: [][0]  # type: ignore[method-assign]
    assert ended(device, seconds=0.2).counts["IndexError as the device was closed"] == 1


@pytest.mark.parametrize(("took_s", "most_s"), [(0.03, 0.05), (0.005, 0.05), (0.0015, 0.1)])
def test_a_device_whose_reads_block_the_loop_is_released(clock: VirtualTime, took_s: float, most_s: float) -> None:
    """The time runs from the first read that blocks to zero force."""
    began: list[int] = []
    times: list[int] = []

    def blocks(tick: int) -> None:
        if tick >= 80:
            began.append(clock.now_ns)
            clock.sleep(took_s)

    device = Moving(blocks)
    device.written = lambda: times.append(clock.now_ns)
    found = ended(device)
    assert found.failed.startswith(f"device: test: its read took {took_s * 1e3:.1f} ms, and a tick has 0.98 ms")
    assert found.counts["slow read"] >= 1
    written = [(at, force) for at, force in zip(times, device.forces, strict=True) if at >= began[0]]
    assert max(force for _, force in written) > 0.3
    assert next(at for at, force in written if force == 0.0) - began[0] <= most_s * 1e9
    assert max(map(abs, device.steps)) <= 2.01 / TICKS, "2 N, as fast as a fault takes it"


def test_one_slow_read_now_and_then_is_no_fault(clock: VirtualTime) -> None:
    found = ended(Moving(lambda tick: clock.sleep(0.004 if tick % 50 == 0 else 0.0002)), seconds=1.0)
    assert found.failed == "the server was silent for the last 1.0 s", "so it is here; of the device not a word"
    assert found.account.state != "fault"
    assert found.counts["slow read"] == 21


@pytest.mark.parametrize(("seconds", "failed"), [(0.004, ""), (0.12, "watchdog: the loop was away for 12")])
@pytest.mark.parametrize("verb", ["read", "write"])
def test_a_late_processor_is_not_blamed_on_the_driver(
    clock: VirtualTime, verb: str, seconds: float, failed: str
) -> None:
    """It is as late a tick as one that is late between two calls, which the watchdog of the loop judges."""
    calls = 0

    def starved(*_: int) -> None:
        nonlocal calls
        calls += 1
        if calls % 4 == 0 and calls > 80:
            clock.starve(seconds)

    device = Moving(starved if verb == "read" else lambda tick: None)
    device.written = starved if verb == "write" else device.written
    found = ended(device, seconds=0.5)
    assert f"slow {verb}" not in found.counts
    assert found.counts[f"processor late in {verb}"] >= 1
    if failed:
        assert found.failed.startswith(failed)
    else:
        assert found.account.state != "fault"
        assert found.counts[f"processor late in {verb}"] > 20, "together more than a driver may take"


def test_a_driver_that_blocks_on_a_busy_machine_is_blamed_all_the_same(clock: VirtualTime) -> None:
    device = Moving(lambda tick: (clock.starve(0.0003), clock.sleep(0.003)) if tick > 80 else None)
    found = ended(device)
    assert found.failed.startswith("device: test: its read took 3.3 ms, and a tick has 0.98 ms")
    assert found.failed.endswith("see to its driver, then re-arm")


def test_a_device_whose_writes_block_gets_zero_with_the_next(clock: VirtualTime) -> None:
    device = Moving()
    device.written = lambda: clock.sleep(0.03)
    assert "its write took 30.0 ms" in ended(device).failed
    assert len(device.forces) <= 4
    assert device.forces[-1] == 0.0


@pytest.mark.parametrize("rate_hz", [1, 128, 1024, 8192])
def test_the_fade_takes_the_same_time_at_any_rate(rate_hz: int) -> None:
    device = Moving()
    fade_out(device, (3.0,), VirtualTime().pacer(rate_hz, 0))  # type: ignore[arg-type]
    assert len(device.forces) == max(1, round(FAULT_OUT_S * rate_hz))
    assert device.forces == sorted(device.forces, reverse=True)
    assert device.forces[-1] == 0.0


@pytest.mark.parametrize("error", [ValueError, OverflowError, ZeroDivisionError])
def test_impossible_settings_are_reported_and_the_seat_is_given_back(
    clock: VirtualTime, error: type[Exception]
) -> None:
    def impossible(profile: object, seed: str) -> Any:
        raise error("link loss = 2")

    device, server = Moving(), Server(delay_ms=5.0)
    with pytest.raises(
        JoinError, match=r"^the server's settings are impossible: link loss = 2; whoever runs the server"
    ):
        client(device, server, impossible).run()
    assert device.did == [], "nothing was opened"
    assert server.goodbyes == {"the server's settings are impossible: link loss = 2"}


def test_a_profile_that_only_the_wire_allows_is_impossible(clock: VirtualTime) -> None:
    profile = LinkProfile(loss=0.5, burst_frames=1.5)
    with pytest.raises(JoinError, match=r"link burst_frames = 1.5 is out of reach at loss = 0.5"):
        client(Moving(), Server(delay_ms=5.0), lambda _, seed: LinkEmulator(profile, seed)).run()
