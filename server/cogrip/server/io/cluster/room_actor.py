"""Actor of a room: it starts the room's process, tells the directory of it, and hands orders on.

It waits, as a spare of its host, until it is given a room: a start takes longer than anyone should wait. The process is an
ordinary server with one room and a UDP port of its own; it ends with its link to the actor. So when a host dies, or Ray there,
or the directory has given the room to another actor, nobody is served twice.
"""

import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import msgspec

from cogrip.protocol.io.platform import system
from cogrip.server.io.cluster.directory import Report
from cogrip.server.io.control import Answer, AnyOrder
from cogrip.server.io.platform import message_pair
from cogrip.server.io.workers.link import (
    Answered,
    AnyToWorker,
    End,
    HandOver,
    Link,
    LinkEndedError,
    Measured,
    Obey,
    Ready,
    Serve,
)
from cogrip.server.snapshot import decode

NAMESPACE, DIRECTORY = "cogrip", "directory"
EVERY_S = 0.25  # a report
ANSWER_S = 3.5
HAND_OVER_S = 10.0
LINGER_S = 1.0  # after the process: somebody may wait for the answer
ORDER = msgspec.json.Decoder(AnyOrder)


class RoomActor:
    """One room, on this host. command: module of the room's process and its arguments."""

    def __init__(self, command: Sequence[str], name: str, host: str, address: str) -> None:
        """name: of this actor; address: of this host, as people reach it."""
        self._report = Report(name, "", 0, host, b"")
        self._address = address
        ours, theirs = message_pair()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", *command, str(theirs.fileno())],
            stdin=subprocess.DEVNULL, **system.own_session(theirs.fileno()),
        )  # fmt: skip
        theirs.close()
        self._link, self._lock = Link(ours), threading.Lock()
        self._answers: dict[int, Answer] = {}
        self._answered = threading.Condition()
        self._number = 0
        threading.Thread(target=self._run, daemon=True).start()

    def serve(self, room: str, job: bytes, number: int, after: str) -> None:
        """Serve a room. after: actor that hands it over, "" for none."""
        import ray
        from ray.exceptions import RayError

        self._report = self._report._replace(room=room, job=job, number=number)
        if after:
            with suppress(RayError, ValueError):  # it has died: its last checkpoint is there
                ray.get(ray.get_actor(after, NAMESPACE).hand_over.remote(), timeout=HAND_OVER_S)
        self._send(Serve(job, number))

    def obey(self, order: bytes) -> bytes:
        """Return the answer to an order."""
        with self._answered:
            self._number += 1
            number = self._number
            self._send(Obey(number, ORDER.decode(order)))
            self._answered.wait_for(lambda: number in self._answers, ANSWER_S)
            answer = self._answers.pop(number, Answer(False, f"room {self._report.room} has not answered; try again"))
        return msgspec.json.encode(answer)

    def hand_over(self) -> None:
        """End the process without a goodbye; return once its checkpoint is written."""
        self._end(HandOver())

    def end(self, reason: str) -> int:
        """Say goodbye to everybody. Returns the process's exit code."""
        return self._end(End(reason))

    def _end(self, message: AnyToWorker) -> int:
        self._send(message)
        try:
            return self._process.wait(HAND_OVER_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()

    def _send(self, message: AnyToWorker) -> None:
        with self._lock:
            self._link.send(message)

    def _run(self) -> None:
        """Follow the process until it ends, or until the directory says that another actor has the room."""
        import ray
        from ray.exceptions import RayError

        directory, due_s = ray.get_actor(DIRECTORY, NAMESPACE), 0.0
        asked: list[Any] = []
        allowed, raylet = True, os.getppid()
        with suppress(LinkEndedError):
            while allowed and os.getppid() == raylet:  # without it the cluster takes this host for dead
                if select.select([self._link.socket], [], [], EVERY_S)[0]:
                    self._take()
                if time.monotonic() >= due_s:
                    due_s = time.monotonic() + EVERY_S
                    allowed, asked = _allowed(ray, RayError, asked)
                    asked.append(directory.report.remote(tuple(self._report)))
            self._process.kill()
        self._process.wait()
        time.sleep(LINGER_S)
        os._exit(0)  # no other thread of Ray's may keep the actor

    def _take(self) -> None:
        with suppress(BlockingIOError):
            while True:
                match self._link.take_at_front():
                    case Ready() as given:
                        self._report = self._report._replace(place=_place(self._address, given.port))
                    case Measured() as given:
                        seats = decode(given.snapshot).rooms[0].seats
                        taken = tuple(seat.user for seat in seats if seat.seated)
                        self._report = self._report._replace(taken=taken, snapshot=given.snapshot)
                    case Answered() as given:
                        with self._answered:
                            self._answers[given.number] = given.answer
                            self._answered.notify_all()


def _allowed(ray: Any, errors: type[Exception], asked: list[Any]) -> tuple[bool, list[Any]]:
    """Return whether no answer to a report forbids to go on, and the reports that have none yet."""
    done, waiting = ray.wait(asked, num_returns=len(asked), timeout=0) if asked else ([], [])
    answers = []
    for each in done:
        with suppress(errors):  # a directory that is started again hears the next one
            answers.append(ray.get(each))
    return all(answers), waiting[-8:]


def _place(address: str, port: int) -> str:
    return f"[{address}]:{port}" if ":" in address else f"{address}:{port}"
