"""The live client: one thread owns the device, the sockets and the core (design: Client process).

A tick: read the device, `sense`, send what the core leaves, drain what has come, `act`, write the force.
"""

import os
import shlex
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from cogrip.client import inputs
from cogrip.client.io.exchange import DatagramExchange, EmulatedDirection
from cogrip.client.io.paths import POLL_S, JoinError, Paths, RefusedError, session_change
from cogrip.client.markers import MOST_UNANSWERED
from cogrip.client.recorder import RecordedClient, client_topics
from cogrip.client.safety.limiter import FAULT_OUT_S, State
from cogrip.client.supervised_device import SupervisedDevice
from cogrip.client.waiting_hand import WaitingHand
from cogrip.devices.device import Capability, Device, DeviceError
from cogrip.devices.for_user import first_axes
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.machine import pacing
from cogrip.machine.platform import system, time
from cogrip.machine.realtime import NAMES, RealTimeMeasure, engage, processor_wait, release
from cogrip.machine.stop import Stop
from cogrip.machine.tick_count import TickCount
from cogrip.protocol.io.recorder import Recorder, open_recorder
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.sink import Nowhere, pack
from cogrip.protocol.settings.hand import parsed, unfit
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.texts import clipped_mark, shown
from cogrip.protocol.wire.accounts import ClientAccount
from cogrip.protocol.wire.messages import Farewell, Hello
from cogrip.protocol.wire.session import ClientSession

CHORES_S = 0.004  # time from one look at paths, orders and the session's end to the next
NEVER = 2**62  # tick that never comes
TYPED_TICKS = 64  # ticks from one look at the terminal, or at what to say there, to the next
LEAD_NS = 2_000_000  # time from the welcome to the first tick
NO_TICKS = TickCount()
ORDERS = "`m TEXT` sets a marker, `c` holds the clutch, `set KEY=VALUE` a scale, `r` re-arms after a fault"


@dataclass(frozen=True, slots=True)
class SessionEnded:
    """End of a session. failed: why it broke off, "" if it did not; ended: who ended it in order before its time.

    trial: what a trial of the motors before it found, "" where there was none
    """

    seat: SeatSettings
    account: ClientAccount
    farewell: Farewell | None
    failed: str
    seconds: float
    counts: dict[str, int]
    measures: list[RealTimeMeasure]
    ended: str = ""
    trial: str = ""


@dataclass(slots=True)
class LiveClient:
    """One person's session. `run` blocks until it has ended; nothing is opened before."""

    device: Device
    hello: Hello
    paths: Paths
    stop: Stop
    say: Callable[[str], None]
    make_link: Callable[[LinkProfile, str], EmulatedDirection]
    record_at: Callable[[SeatSettings], Path | None]
    seconds: float | None = None
    rearms: bool = False  # stay after a fault, without force, until the person re-arms; else a fault ends the session
    judge: Callable[[SeatSettings, Capability], str] = lambda seat, record: ""  # why not to hold the device so, or ""
    over: Callable[[], str] = lambda: ""  # why it ends by itself before its time, "" while it goes on
    allow_unstable: bool = False  # hold a device that is asked for more than it carries; never one of hardware
    clutched: bool = False  # begin with the clutch held
    each_frame: Callable[[RecordedClient, int], None] | None = None  # called once a network frame, with its number
    waits: SimulatedDevice | None = None  # part of the device: begins, and `seconds` with it, when everybody holds on
    resume_s: float | None = None  # silence after which a resumption is given up; as usual if not given
    trial: str = ""  # what a trial of the motors found, for the recording and the account of the end
    _core: RecordedClient = field(init=False)
    _exchange: DatagramExchange = field(init=False)
    _counts: dict[str, int] = field(init=False, default_factory=dict)
    _unkept: bool | None = field(init=False, default=None)  # the clutch as it was before `hold`; None without
    _faulted: bool = field(init=False, default=False)  # a fault was said, and no force has been let in since
    _told: int = field(init=False, default=0)  # newest change of the administrator that the person was told of

    def run(self) -> SessionEnded | ClientSession:
        """Return the session once it has ended; or at once, and still open, where the server gives an observer's place only.

        Raises JoinError when there is no seat to be had, DeviceError when the device cannot be opened.
        """
        core = self._core = RecordedClient(self.hello, self.device.capability)
        self._exchange = DatagramExchange(core, self.paths)
        if self.resume_s is not None:
            core.handle(inputs.Patience(round(self.resume_s * 1e9)), time.monotonic_ns())
        # before there is a seat to lose: locking memory can take a second on a busy machine
        measures = engage(name for name in NAMES if name != "fifo")
        try:
            self.paths.connect(core, self.stop)
            if not core.seated:
                core.record(Nowhere())
                return core.session
            return self._session(measures)
        finally:
            release(measures)

    def _session(self, measures: list[RealTimeMeasure]) -> SessionEnded:
        core, seat = self._core, self._core.seat
        assert seat is not None
        self._link(seat)
        self._exchange.half_tick_ns = round(0.5e9 * seat.rates.tick_s)
        device = self.device = first_axes(self.device, seat.object.axes)
        spared = not self.allow_unstable
        supervised = SupervisedDevice(
            device, core, seat.rates.device_hz, time.monotonic_ns, processor_wait(), spared=spared
        )
        recorder = None
        try:
            try:
                supervised.open()
            except DeviceError as error:
                self._leave(f"device: {error}")
                raise
            self._keep_seat()
            if refused := self.judge(seat, core.capability):
                self._leave(refused)
                raise RefusedError(refused)
            self._keep_seat()
            recorder = self._record(seat)
            self._keep_seat()
            measures += engage(["fifo"])  # last of all preparations: they would starve others
            self.say(f"{seat.user} holds {seat.object.kind} in room {seat.room} with {self.hello.device}")
            if self.clutched:
                core.handle(inputs.Clutch(True), time.monotonic_ns())
            pacer = pacing.Pacer(seat.rates.device_hz, time.monotonic_ns() + LEAD_NS)
            try:
                failed = self._loop(pacer, supervised)
            except BaseException:  # a defect, wherever it is: the hand may be pushed by the last force
                fade_out(device, core.force_n, pacer)
                raise
            account = self._leave(failed, pacer.count())
        finally:
            supervised.close()
            core.record(Nowhere())
            if recorder is not None:
                recorder.close()
        seconds = pacer.due / seat.rates.device_hz
        if recorder is not None and recorder.trouble:
            self._counts["recording stopped"] = 1
        if recorder is not None and recorder.lost:
            self._counts["not recorded"] = recorder.lost
        counts = {
            **core.session.dropped, **core.safety.counts, **device.counts, **supervised.counts, **self.paths.counted(),
            **self._counts, "resumed": core.session.resumed, "line begun anew": core.session.renewed,
            "skipped tick": pacer.skipped,
        }  # fmt: skip
        ended = core.session.ended or self.stop.reason or self.over()
        held = core.seated.settings if core.seated is not None else seat  # as they were changed in the session
        return SessionEnded(held, account, core.session.farewell, failed, seconds, counts, measures, ended, self.trial)

    def _link(self, seat: SeatSettings) -> None:
        """Emulate the link of the settings. Gives the seat back where that is impossible. Raises JoinError."""
        try:
            self._exchange.up, self._exchange.down = [
                None if profile == LinkProfile() else self.make_link(profile, f"{seat.seed}/{seat.seat}/{name}")
                for profile, name in ((seat.up, "up"), (seat.down, "down"))
            ]
        except (ValueError, ArithmeticError) as error:
            text = f"the server's settings are impossible: {error}"
            self._leave(text)
            raise JoinError(f"{text}; whoever runs the server can mend its [link]") from None

    def _record(self, seat: SeatSettings) -> Recorder | None:
        """Begin to record, from the first hello on; None where nothing is recorded."""
        core, path = self._core, self.record_at(seat)
        recorder = None
        if path is not None:
            epoch_ns = time.time_ns() - time.monotonic_ns()
            header = Header(
                "client", seat.user, core.start, seat.rates.device_hz, seat.seed, epoch_ns, False, versions_here(),
                client_topics(seat.user), seat.room, trial=self.trial,
            )  # fmt: skip
            recorder = open_recorder(path, header, self.say)
            if recorder is None:
                self._counts["recording stopped"] = 1
        core.record(recorder or Nowhere(), pack)
        return recorder

    def _keep_seat(self) -> None:
        """Send a sign of life while the device and the rest are made ready."""
        now_ns = time.monotonic_ns()
        self._core.handle(inputs.KeepSeat(), now_ns)
        self._exchange.send(now_ns)

    def _loop(self, pacer: pacing.Pacer, supervised: SupervisedDevice) -> str:
        """Tick until the session ends and the hand is released. Returns why it failed, "" if it did not."""
        core, safety, session, exchange = self._core, self._core.safety, self._core.session, self._exchange
        last_tick = None if self.seconds is None else round(self.seconds * pacer.rate_hz)
        waiting = WaitingHand(self.waits, pacer.rate_hz, self.say)
        safety_state, session_state = safety.state, session.state
        failed: str | None = None  # once the session is being ended: why it failed, "" if it did not
        seat = core.seat
        assert seat is not None
        ticks_per_frame, work_us = seat.rates.ticks_per_frame, 0
        chore_ticks = max(1, round(CHORES_S * pacer.rate_hz))
        next_chores = next_look = 0
        next_frame = NEVER if self.each_frame is None else 0
        while True:
            over_at = NEVER if last_tick is None else last_tick + waiting.ticks
            chores_at = 0 if failed is not None or self._unkept is not None else min(next_chores, over_at)
            until = min(chores_at, next_frame)
            tick, now_ns = run_ticks(core, exchange, supervised, pacer, work_us, until, session_state, safety_state)
            if session.state != session_state:
                if text := session_change(session, session_state, session.state):
                    self.say(text)
                session_state = session.state
            if safety.state != safety_state:
                self._report_safety(safety_state, safety.state)
                safety_state = safety.state
            if tick >= chores_at:
                next_chores, looks = tick + chore_ticks, tick >= next_look
                self._poll_paths(now_ns)
                waiting.poll(tick, core.markers.everybody)
                if looks:
                    next_look = tick + TYPED_TICKS
                    self._tell_changes()
                if failed is None:
                    self._obey(looks, now_ns, supervised)
                    failed = self._end(tick >= over_at, now_ns)
                elif core.may_leave:
                    return failed
            if self.each_frame is not None and tick >= next_frame:
                self.each_frame(core, tick // ticks_per_frame)
                next_frame = (tick // ticks_per_frame + 1) * ticks_per_frame
            pacer.done()
            work_us = (time.monotonic_ns() - now_ns) // 1000

    def _end(self, over: bool, now_ns: int) -> str | None:
        """Begin to end the session, where that is due. Returns why it failed, "" if it did not; None where it goes on."""
        core, safety, session = self._core, self._core.safety, self._core.session
        failed = self._why() if session.failed or safety.state == "fault" else ""
        if not (failed or self.stop.reason or over or self.over() or session.state == "closed"):
            return None
        failed = failed or self._server_silent(now_ns)
        if safety.state == "fault":
            return failed or f"it ended in a fault: {safety.reason}"
        core.handle(inputs.Stop(), now_ns)
        return failed

    def _obey(self, looks: bool, now_ns: int, supervised: SupervisedDevice) -> None:
        """Do what is asked for: leave a fault, set a marker, hold the clutch or release it. looks: at the terminal, too."""
        if self.rearms and self._core.safety.state == "fault":
            self._rearm(supervised)
        if (seat := self._core.seated) is None:
            return
        if self._unkept is not None and not seat.clutched:  # an administrator's change, or a new session
            self._core.handle(inputs.Clutch(True), now_ns)
        if not looks:
            return
        for line in self.stop.take_typed():
            if line in ("hold", "engage"):
                self._keep_clutched(line == "hold", seat.clutched, now_ns)
            elif self._unkept is not None and line.lower() == "c":
                self.say("held off: `c` has no effect")
            elif line.startswith("m "):
                refused = self._core.markers.refused
                self._core.handle(inputs.Mark(line[2:]), now_ns)
                text = clipped_mark(line[2:])
                if self._core.markers.refused > refused:
                    self.say(f"no marker {text!r}: {MOST_UNANSWERED} are on their way; set it once the server answers")
                else:
                    self.say(f"marker: {text}")
            elif line.startswith("set "):
                self._set_hand(seat.settings, line.removeprefix("set "), now_ns)
            elif line.lower() == "c" and self._core.safety.state != "fault":
                clutched = not seat.clutched
                self._core.handle(inputs.Clutch(clutched), now_ns)
                held, free = "clutched: the tool stands still; `c` and Enter engage", "engaged: force ramps in"
                self.say(held if clutched else free)
            else:
                self.say(f"{shown(line)!r} is no order: {ORDERS}")

    def _keep_clutched(self, kept: bool, clutched: bool, now_ns: int) -> None:
        """Hold the clutch whatever else asks for it, also in a fault; or let it be as it was before."""
        if kept is (self._unkept is not None):
            return
        before, self._unkept = self._unkept, clutched if kept else None
        held = kept or bool(before)
        self._core.handle(inputs.Clutch(held), now_ns)
        self.say(
            "held off: the tool stands still" if kept else "clutched as before" if held else "engaged: force ramps in"
        )

    def _poll_paths(self, now_ns: int) -> None:
        if self.paths.poll(now_ns, self._core.session.state == "resuming"):
            self._core.handle(inputs.Reached(), now_ns)

    def _tell_changes(self) -> None:
        """Tell the person what the administrator has set."""
        if (seat := self._core.seated) is not None and seat.orders.changes.reported != self._told:
            if seat.orders.changes.reported:  # else a new session has begun
                self.say(f"the administrator has set your hand: {seat.orders.changes.holds.text}")
            self._told = seat.orders.changes.reported

    def _set_hand(self, seat: SeatSettings, text: str, now_ns: int) -> None:
        """Change the person's own hand settings."""
        try:
            change = parsed(shlex.split(text))
            if others := list(change.of_line()):
                raise ValueError(
                    f"{others[0]} is the room's; its administrator changes it: cogrip set {seat.user} {text}"
                )
            if why := unfit(change, seat.object.axes):
                raise ValueError(why)
        except ValueError as error:
            self.say(f"not set: {error}")
            return
        self._core.handle(inputs.SetHand(change), now_ns)
        self.say(f"set: {change.text}; force ramps in")

    def _rearm(self, supervised: SupervisedDevice) -> None:
        """Leave a fault when the person asks for it, with the device opened anew; say what came of it."""
        if self.stop.take_rearm():
            self._keep_seat()  # opening may take a while
            refused = supervised.rearm()
            now_ns = time.monotonic_ns()
            self._exchange.drain(now_ns)  # what waited meanwhile, before the server is treated as silent
            self._core.handle(inputs.Poll(), now_ns)  # recorded: a replay then receives it before the next tick, too
            self.say(f"not re-armed: {refused}" if refused else "re-arming")
        if supervised.refusal:
            self.say(f"not re-armed: {supervised.refusal}")
            supervised.refusal = ""

    def _why(self) -> str:
        """Return why the session cannot go on, "" where it can: in a fault, where the person may re-arm."""
        safety, failed = self._core.safety, self.paths.explained(self._core.session.failed)
        return failed or (safety.reason if safety.state == "fault" and not self.rearms else "")

    def _server_silent(self, now_ns: int) -> str:
        """Return why an end that is no failure by itself is one: the server does not learn of it; "" where it does."""
        session = self._core.session
        silent_s = (now_ns - session.last_received_ns) / 1e9
        return f"the server was silent for the last {silent_s:.1f} s" if session.state == "resuming" else ""

    def _report_safety(self, before: State, after: State) -> None:
        reason = self._core.safety.reason
        if after == "degraded":
            self.say(f"force released: {reason}")
        elif after == "fault":
            self._faulted = True
            self.stop.take_rearm()  # what was asked before the fault was not asked of it; what answers these words is
            self.say(f"fault, force released: {reason}")
            if self.rearms:
                self.say(f"see to its cause; then {system.REARM_HOW.format(os.getpid())} re-arms; Ctrl-C leaves")
        elif self._faulted and after in ("live", "clutched"):
            self._faulted = False
            self.say("re-armed: force ramps in" if after == "live" else "re-armed: the clutch is held")
        elif before == "degraded" and after == "live":
            self.say("the server answers again: force ramps in")

    def _leave(self, failed: str, ticks: TickCount = NO_TICKS) -> ClientAccount:
        """Say goodbye with the account of this end, and wait a moment for the answer."""
        core, session = self._core, self._core.session
        now_ns = time.monotonic_ns()
        account = core.handle(inputs.CloseLedger(ticks), now_ns)
        assert account is not None
        reason = failed or self.stop.reason or self.over() or "the session is over"
        core.handle(inputs.Leave(reason[:300]), now_ns)
        if session.state != "leaving":  # the server stopped first: it waits for our account
            self._exchange.up = None
            self._exchange.send(now_ns)
        while session.state == "leaving":
            now_ns = time.monotonic_ns()
            core.handle(inputs.Poll(), now_ns)
            self._exchange.send(now_ns)
            self._exchange.drain(now_ns)
            self.paths.poll(now_ns, resuming=False)
            time.sleep(POLL_S)
        return account


def run_ticks(
    core: RecordedClient, exchange: DatagramExchange, supervised: SupervisedDevice, pacer: pacing.Pacer, work_us: int,
    until: int, session_state: str, safety_state: str,
) -> tuple[int, int]:  # fmt: skip
    """Run ticks to `until`, or one that changes a state: return it, not done, and its begin [ns]. work_us: of one before."""
    session, safety, clock = core.session, core.safety, time.monotonic_ns
    while True:
        tick = pacer.wait()
        now_ns = pacer.started_ns
        core.sense(tick, supervised.read(tick), now_ns)
        exchange.send(now_ns)
        exchange.drain(clock())  # what came since the tick began was sent by a server that had it so long
        core.timing = (pacer.late_ns // 1000, work_us, pacer.skipped)
        supervised.write(core.act(now_ns))
        if tick >= until or session.state != session_state or safety.state != safety_state:
            return tick, now_ns
        end_ns = clock()
        work_us = (end_ns - now_ns) // 1000
        pacer.done_at(end_ns, 0)


def fade_out(device: Device, force_n: Sequence[float], pacer: pacing.Pacer) -> None:
    """Fade `force_n` [N], shape (axes,), out over FAULT_OUT_S, past all other parts. Raises nothing; `close` does the rest."""
    ticks = max(1, round(FAULT_OUT_S * pacer.rate_hz))
    with suppress(Exception):  # there is one on its way already
        for left in reversed(range(ticks)):
            tick = pacer.wait()
            with suppress(Exception):  # it may be what failed; some devices are written to by being read
                device.read(tick)
            device.write([force * left / ticks for force in force_n])
