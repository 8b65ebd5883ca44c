"""Template of the processes of rooms: it has imported all that they need, and forks one in milliseconds.

A process that is started instead imports for a second and more of processor time: a host that is drained has many rooms, and
its people wait.
"""

import gc
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence

from cogrip.machine.platform import system
from cogrip.machine.server_platform import fork, message_pair, receive_with_descriptors, send_with_descriptors

FORK = b"fork"
MOST_BYTES = 64
ANSWER_S = 60.0  # longest wait for an answer, its own start among it, on a host that is busy


class TemplateError(Exception):
    """The template has gone, or cannot be started."""


class Template:
    """Template as its parent sees it. command: module that calls `serve_forks`, and its arguments."""

    def __init__(self, command: Sequence[str]) -> None:
        self._command = tuple(command)
        self._start()

    def _start(self) -> None:
        self._socket, theirs = message_pair()
        self._socket.settimeout(ANSWER_S)
        environ = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # no thread must be there when it forks
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", *self._command, str(theirs.fileno())],
            stdin=subprocess.DEVNULL, env=environ, **system.own_session(theirs.fileno()),
        )  # fmt: skip
        theirs.close()

    def fork(self) -> tuple[socket.socket, int]:
        """Return the link to a new process, and its id. Raises TemplateError; the next call finds a new template then."""
        ours, theirs = message_pair()
        try:
            with theirs:
                send_with_descriptors(self._socket, [FORK], [theirs.fileno()])
            answer = self._socket.recv(MOST_BYTES)
            return ours, int(answer)
        except (OSError, ValueError):
            ours.close()
            self.close()
            self._start()
            raise TemplateError from None

    def close(self) -> None:
        """End the template; what it has forked goes on."""
        self._socket.close()
        self._process.kill()
        self._process.wait()


def serve_forks(descriptor: int, run: Callable[[socket.socket], int]) -> int:
    """Fork a process that calls `run` with its link as often as the parent asks, until it has gone."""
    parent = socket.socket(fileno=descriptor)
    gc.collect()
    gc.freeze()  # or a collection would copy what is shared
    while True:
        data, descriptors, _, _ = receive_with_descriptors(parent, MOST_BYTES, 1)
        if not data or not descriptors:
            return 0
        pid = fork()
        if pid == 0:
            parent.close()
            return run(socket.socket(fileno=descriptors[0]))
        os.close(descriptors[0])
        parent.send(str(pid).encode())
