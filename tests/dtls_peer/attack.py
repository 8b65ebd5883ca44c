"""Attacks of unauthenticated peers on a running server, over loopback."""

import socket
import time
from collections.abc import Callable
from contextlib import suppress

from cogrip.protocol.secure.channel import PEER

from tests.dtls_peer import records
from tests.dtls_peer.client import DtlsPeer
from tests.dtls_peer.records import CHANGE_CIPHER_SPEC, CLIENT_KEY_EXCHANGE, FINISHED, HANDSHAKE

HOST = "127.0.0.1"
ANNOUNCED = 100_000  # bytes of a handshake message that never comes
FRAGMENTS = 11  # more than OpenSSL keeps
ADDRESSES = 200
LIVES_S = 2.0  # an attacker gives a handshake up that has gone no further
PAUSE_S = 0.0005


class HalfOpen(DtlsPeer):
    """Stops after the server's first flight."""

    def answer_server_hello(self) -> None:
        self.halted = True


def encrypted_fragments(peer: DtlsPeer) -> None:
    """Parts of long handshake messages, after the handshake."""
    for seq in range(4, 4 + FRAGMENTS):
        peer.put(peer.fragment(records.CLIENT_HELLO, seq, b"x" * 12, ANNOUNCED))


def encrypted_before_finished(peer: DtlsPeer) -> None:
    """The same with keys that the server has, in place of Finished."""
    one_before_finished(peer)
    for seq in range(4, 3 + FRAGMENTS):
        peer.put(peer.fragment(FINISHED, seq, b"x" * 12, ANNOUNCED))


def one_before_finished(peer: DtlsPeer) -> None:
    """A part of a long message in place of Finished, and nothing more: as much as a server can be made to keep."""
    peer.read_server()
    peer.put(peer.record(HANDSHAKE, peer.key_exchange(), 0), peer.record(CHANGE_CIPHER_SPEC, b"\x01", 0))
    peer.put(peer.fragment(FINISHED, 3, b"x" * 12, ANNOUNCED))


def plaintext_fragments(peer: DtlsPeer) -> None:
    """Parts of long messages before there are keys."""
    for seq in range(2, 2 + FRAGMENTS):
        peer.put(peer.fragment(CLIENT_KEY_EXCHANGE, seq, b"x" * 12, ANNOUNCED))


ATTACKS: dict[str, tuple[type[DtlsPeer], Callable[[DtlsPeer], None]]] = {
    "encrypted fragments": (DtlsPeer, encrypted_fragments),
    "encrypted before Finished": (HalfOpen, encrypted_before_finished),
    "one before Finished": (HalfOpen, one_before_finished),
    "plaintext fragments": (HalfOpen, plaintext_fragments),
}


class Attacker:
    """One handshake from a port of its own, and what follows it."""

    def __init__(self, attack: str, source: str, port: int, now_s: float) -> None:
        kind, self._act = ATTACKS[attack]
        self.peer = kind()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((source, 0))
        self.socket.connect((HOST, port))
        self.socket.setblocking(False)
        self.until_s = now_s + LIVES_S
        self.reached = False

    def step(self, now_s: float) -> bool:
        """False when it is over."""
        peer, now_ns = self.peer, round(now_s * 1e9)
        peer.poll(now_ns)
        with suppress(BlockingIOError, ConnectionRefusedError):
            while True:
                peer.receive(self.socket.recv(4096), PEER, now_ns)
        if not self.reached and (peer.ready() or peer.halted):
            self.reached = True
            self._act(peer)
        while peer.outbox:
            with suppress(OSError):
                self.socket.send(peer.outbox.popleft()[1])
        return not self.reached and not peer.failed and now_s < self.until_s

    def close(self) -> None:
        self.socket.close()


def attack(port: int, kind: str, handshakes: int, per_second: float) -> int:
    """Begin so many handshakes; returns how many came as far as the attack."""
    begun_s = time.monotonic()
    alive: list[Attacker] = []
    begun = reached = 0
    while begun < handshakes or alive:
        now_s = time.monotonic()
        while begun < handshakes and begun <= (now_s - begun_s) * per_second:
            source = f"127.3.0.{1 + begun % ADDRESSES}"
            alive.append(Attacker(kind, source, port, now_s))
            begun += 1
        for each in list(alive):
            if not each.step(now_s):
                reached += each.reached
                each.close()
                alive.remove(each)
        time.sleep(PAUSE_S)
    return reached
