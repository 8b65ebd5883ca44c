"""A server's socket on this machine, and paths that are drained until something has come of it."""

import socket
from collections.abc import Callable

from cogrip.client.io.paths import Paths

from tests.fair_time import FairTime

LIMIT_S = 60.0


class FarServer:
    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(LIMIT_S)
        self.port = int(self.socket.getsockname()[1])
        self.place = f"127.0.0.1:{self.port}"

    def hear(self) -> tuple[bytes, object]:
        """Wait for the next datagram. Returns it with its address."""
        return self.socket.recvfrom(2000)

    def say(self, words: bytes, address: object) -> None:
        self.socket.sendto(words, address)  # type: ignore[call-overload]

    def answer(self, words: bytes) -> bytes:
        """Wait for a datagram, and answer it. Returns it."""
        heard, address = self.hear()
        self.say(words, address)
        return heard


def drain_until(
    paths: Paths, done: Callable[[list[bytes]], bool], *redirect: Callable[[bytes], object], hello: bytes = b""
) -> list[bytes]:
    """Drain until `done` says so of what has come, and send this hello each time. A `welcome` is the answer to a hello."""
    taken: list[bytes] = []
    waited = FairTime()
    while not done(taken):
        assert waited.spent_s() < LIMIT_S, "nothing came"
        if hello:
            paths.send(hello, hello=True)
        paths.drain(0, lambda message, at_ns: taken.append(message), lambda message: message == b"welcome", *redirect)
    return taken
