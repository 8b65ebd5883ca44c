"""The far end of `dev.py bench relay`, in a process of its own: `python -m tests.bench.loads.echo`.

It prints its port. 128 times a second it answers everybody who has spoken, all in one burst as a server does, and writes into
each answer when the kernel had the question and when the answer left. The end of standard input ends it.
"""

import os
import select
import socket
import struct
import sys
import time
from typing import Any

from cogrip.machine.pacing import Pacer
from cogrip.machine.realtime import engage, release
from cogrip.machine.receive_buffer import enlarge

from tests.bench import machine

HOST = "127.0.0.1"
NETWORK_HZ = 128
SO_TIMESTAMPNS = 35  # Linux: when the kernel had a datagram, by CLOCK_REALTIME
STAMP = struct.Struct("<QQQQ")  # number; sent by the client, had by our kernel, answered [ns]
TIMESPEC = struct.Struct("@qq")
MOST_BYTES = 2048


def stamped(receiver: socket.socket) -> None:
    """Have the kernel tell when it got what this socket receives."""
    enlarge(receiver)
    receiver.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    receiver.setblocking(False)


def receive(receiver: socket.socket) -> tuple[bytes, int, Any]:
    """Datagram, when the kernel had it [ns], and whose it is. Raises BlockingIOError."""
    datagram, told, _, address = machine.receive_stamped(receiver, MOST_BYTES)
    seconds, rest_ns = TIMESPEC.unpack(told[0][2])
    return datagram, seconds * 1_000_000_000 + rest_ns, address


def main() -> None:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stamped(end)
    end.bind((HOST, 0))
    sys.stdout.write(f"{end.getsockname()[1]}\n")
    sys.stdout.flush()
    measures = engage()
    pacer = Pacer(NETWORK_HZ, time.monotonic_ns())
    while not (select.select([0], [], [], 0.0)[0] and not os.read(0, 1)):
        pacer.wait()
        heard = []
        try:
            while True:
                heard.append(receive(end))
        except BlockingIOError:
            pass
        for datagram, had_ns, address in heard:
            number, sent_ns, *_ = STAMP.unpack_from(datagram)
            answer = STAMP.pack(number, sent_ns, had_ns, time.time_ns()) + datagram[STAMP.size :]
            end.sendto(answer, address)
        pacer.done()
    release(measures)


if __name__ == "__main__":
    main()
