"""A flood of datagrams from many addresses of loopback, in its own process: `python -m tests.bench.loads.flood`.

Its job stands on standard input; what it sent on standard output, once it is over. Linux: elsewhere loopback has one address.
"""

import random
import socket
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress

import msgspec

from cogrip.machine.pacing import Pacer
from cogrip.protocol.io.dtls import cookie_in
from cogrip.protocol.io.dtls_client import DtlsClient
from cogrip.protocol.secure.channel import PEER
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES, padded
from cogrip.protocol.wire.session import make_hello

from tests.bench.children import start_python

ADDRESSES = 1000
PER_SECOND = 20_000
BURSTS_HZ = 500
SAMPLES = 64  # of each kind
ANSWER_S = 2.0
END_LIMIT_S = 30.0
MIX = "mix"


class Job(msgspec.Struct, frozen=True):
    """samples: datagrams to send, one after the other, again and again."""

    host: str
    port: int
    seconds: float
    samples: tuple[bytes, ...]
    per_second: int = PER_SECOND
    addresses: int = ADDRESSES


class Done(msgspec.Struct, frozen=True):
    sent: int
    refused: int  # by this machine
    addresses: int
    seconds: float

    @property
    def per_second(self) -> float:
        return self.sent / self.seconds


class Flood:
    """A flood that is under way; `end` waits for it."""

    def __init__(self, job: Job) -> None:
        self._child = start_python("-m", "tests.bench.loads.flood")
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        self._child.stdin.write(msgspec.msgpack.encode(job))
        self._child.stdin.close()
        self._child.stdout.readline()  # it begins

    def end(self) -> Done:
        assert self._child.stdout is not None
        try:
            said = self._child.stdout.read()
            self._child.wait(END_LIMIT_S)
        finally:
            self.kill()
        return msgspec.json.decode(said, type=Done)

    def kill(self) -> None:
        if self._child.poll() is None:
            self._child.kill()
        self._child.wait()
        if self._child.stdout is not None:
            self._child.stdout.close()


def samples_of(
    server: tuple[str, int], fingerprint: str, records: Sequence[bytes], seed: int = 1
) -> dict[str, tuple[bytes, ...]]:
    """Return what unauthenticated peers can send an encrypted server, by kind. records: datagrams of a real session."""
    chance = random.Random(seed)
    whole, wrong = _hellos(server, fingerprint, chance)
    kinds = {
        "random bytes": tuple(chance.randbytes(chance.randrange(MAX_DATAGRAM_BYTES + 100)) for _ in range(SAMPLES)),
        "unencrypted hellos": tuple(_unencrypted_hello(chance) for _ in range(SAMPLES)),
        "ClientHellos": whole,
        "forged cookies": wrong,
        "replayed records": tuple(records[-SAMPLES:]),
    }
    everything = [sample for samples in kinds.values() for sample in samples]
    chance.shuffle(everything)
    return {**kinds, MIX: tuple(everything)}


def _unencrypted_hello(chance: random.Random) -> bytes:
    return padded(make_hello(
        software="flood", nonce=chance.randrange(1, 2**62), room="", name="", digest="", device="sim:none", axes=3,
        rate_hz=1024.0,
    ))  # fmt: skip


def _hellos(
    server: tuple[str, int], fingerprint: str, chance: random.Random
) -> tuple[tuple[bytes, ...], tuple[bytes, ...]]:
    """ClientHellos without a cookie; and some with the cookie of another address, or with one that was made up."""
    calls = [DtlsClient(fingerprint) for _ in range(SAMPLES)]
    for call in calls:
        call.poll(time.monotonic_ns())
    whole = tuple(call.outbox.popleft()[1] for call in calls)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as near:
        near.connect(server)
        near.settimeout(ANSWER_S)
        near.send(whole[0])
        calls[0].receive(near.recv(2 * MAX_DATAGRAM_BYTES), PEER, time.monotonic_ns())
    theirs = calls[0].outbox.popleft()[1]
    cookie = cookie_in(theirs)
    made_up = [theirs.replace(cookie, chance.randbytes(len(cookie))) for _ in range(SAMPLES - 1)]
    return whole, (theirs, *made_up)


def flood(job: Job) -> Done:
    """Send, evenly, for so long."""
    with ExitStack() as stack:
        ends = []
        for number in range(job.addresses):
            end = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            end.bind((f"127.1.{number // 250}.{1 + number % 250}", 0))
            end.setblocking(False)
            ends.append(end)
        print(flush=True)
        where, samples = (job.host, job.port), job.samples
        sent = refused = number = 0
        begun_ns = time.monotonic_ns()
        pacer = Pacer(BURSTS_HZ, begun_ns)
        last = round(job.seconds * BURSTS_HZ)
        while (burst := pacer.wait()) < last:
            wanted = (burst + 1) * job.per_second // BURSTS_HZ  # bursts that were missed are made up for
            while number < wanted:
                with suppress(OSError):
                    ends[number % job.addresses].sendto(samples[number % len(samples)], where)
                    sent += 1
                number += 1
        refused = number - sent
        return Done(sent, refused, job.addresses, (time.monotonic_ns() - begun_ns) * 1e-9)


def main() -> None:
    job = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Job)
    print(msgspec.json.encode(flood(job)).decode())


if __name__ == "__main__":
    main()
