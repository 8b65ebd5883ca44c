"""Process of a room as the actor of its host sees it: messages both ways over a link, and what it said last."""

import select
import threading
from collections.abc import Callable
from contextlib import suppress

from cogrip.machine.server_platform import end_at_once
from cogrip.server.administration.orders import AnyOrder, OrderReply
from cogrip.server.events import ServerEvent
from cogrip.server.hosting.cluster.directory import Report
from cogrip.server.hosting.cluster.template import Template
from cogrip.server.hosting.link import (
    Answered,
    AnyToWorker,
    Begin,
    DirectoryContact,
    EndRooms,
    HandOver,
    LinkEndedError,
    NewSnapshot,
    Obey,
    ProcessEnded,
    ProcessLink,
    Ready,
    Said,
    Saved,
    Serve,
)
from cogrip.server.snapshot import decode

ANSWER_S = 3.5
READY_S = 25.0
END_S = 10.0


class RoomProcess:
    """One process. report: its newest state; changed, said, saved: called in a thread of this."""

    def __init__(
        self, template: Template, report: Report, address: str, changed: Callable[[], None],
        said: Callable[[ServerEvent], None], saved: Callable[[str, int, bytes], None],
    ) -> None:  # fmt: skip
        """address: of this host, as people reach it. Raises TemplateError."""
        self.report = report
        self._address, self._changed, self._said, self._saved = address, changed, said, saved
        connection, self._pid = template.fork()
        self._link, self._lock = ProcessLink(connection), threading.Lock()
        self._news = threading.Condition()
        self._answers: dict[int, OrderReply] = {}
        self._number = 0
        self._place = ""  # prepared, and told once the room has begun
        self._last: bytes | None = None
        self._code: int | None = None
        threading.Thread(target=self._run, name=report.room, daemon=True).start()

    def prepare(self) -> bool:
        """Let it get all ready for the room. Returns whether it is; once it has ended it is not."""
        report = self.report
        self._send(Serve(report.job, report.number, self._address))
        with self._news:
            self._news.wait_for(lambda: self._place or self.report.ended, READY_S)
        return bool(self._place) and not self.report.ended

    def begin(self, checkpoint: bytes) -> None:
        """Let the room begin; from now on its place is told."""
        self._send(Begin(checkpoint))

    def note_directory(self, answers: bool) -> None:
        """Tell whether the directory answers."""
        self._send(DirectoryContact(answers))

    def obey(self, order: AnyOrder) -> OrderReply:
        """Return the answer to an order."""
        with self._news:
            self._number += 1
            number = self._number
            self._send(Obey(number, order))
            self._news.wait_for(lambda: number in self._answers or self.report.ended, ANSWER_S)
            return self._answers.pop(number, OrderReply(False, f"room {self.report.room} has not answered; try again"))

    def hand_over(self) -> bytes:
        """Let the room end without a goodbye. Returns its last checkpoint, b"" where none has come."""
        self._send(HandOver())
        with self._news:
            self._news.wait_for(lambda: self._last is not None or self.report.ended, END_S)
            return self._last or b""

    def end(self, reason: str) -> int:
        """Say goodbye to everybody. Returns the exit code."""
        self._send(EndRooms(reason))
        with self._news:
            if not self._news.wait_for(lambda: self.report.ended, END_S):
                self.kill()
                self._news.wait_for(lambda: self.report.ended, END_S)
            return 1 if self._code is None else self._code

    def kill(self) -> None:
        """End it at once."""
        if not self.report.ended:  # its id may be another's later
            end_at_once(self._pid)

    def _send(self, message: AnyToWorker) -> None:
        with self._lock:
            self._link.send(message)

    def _run(self) -> None:
        with suppress(LinkEndedError):
            while True:
                select.select([self._link.socket], [], [])
                with suppress(BlockingIOError):
                    while True:
                        self._take()
        with self._news:
            self.report = self.report._replace(place="", taken=(), snapshot=b"", ended=True)
            self._news.notify_all()
        self._changed()

    def _take(self) -> None:
        match self._link.take_at_front():
            case Ready() as given if not self._place:
                with self._news:
                    self._place = _place(self._address, given.port)
                    self.report = self.report._replace(number=given.number)
                    self._news.notify_all()
            case Ready():  # the room has begun
                self.report = self.report._replace(place=self._place)
                self._changed()
            case NewSnapshot() as given:
                seats = decode(given.snapshot).rooms[0].seats
                taken = tuple(seat.user for seat in seats if seat.seated)
                self.report = self.report._replace(taken=taken, snapshot=given.snapshot)
            case Said() as given:
                self._said(given.line)
            case Saved() as given:
                if given.last:
                    with self._news:
                        self._last = given.checkpoint
                        self._news.notify_all()
                self._saved(self.report.room, self.report.number, given.checkpoint)
            case ProcessEnded() as given:
                self._code = given.code
            case Answered() as given:
                with self._news:
                    self._answers[given.number] = given.answer
                    self._news.notify_all()


def _place(address: str, port: int) -> str:
    return f"[{address}]:{port}" if ":" in address else f"{address}:{port}"
