"""A ring buffer of messages in shared memory: one loop writes, one process reads, neither waits for the other.

    0    u64  bytes put so far (written by the loop)
    8    u64  bytes taken so far (written by the reader)
    16   u64  messages that did not fit
    24   u64  1: nothing more will come
    32   u64  length of the reader's report
    40   u64  messages that the reader has saved
    48   its text
    PAGE data: u64 length + 2^32 topic, u64 time, payload; padded to 8 bytes; never across the end

A length of SKIP means: go on at the start. Topic LOST is the ring's own: so many messages (u64) did not fit here.
Both counters only grow, and each has one writer; a message's bytes are there before its counter says so. Counters are
items of a cast view, stored all eight bytes at once: `struct` zeroes before it packs, and the other side would see that.
Words have the machine's own byte order.
"""

import mmap
import os
import tempfile
from collections.abc import Iterator
from struct import Struct

from cogrip.machine.byte_copy import copy_into

PAGE = 4096
SKIP = 0xFFFF_FFFF
LOST = 0xFFFF
_U64 = Struct("Q")
_COUNTERS = 6
_HEAD_BYTES = 16
_TOPIC_BITS = 32  # bits by which the topic is shifted in a record's first word; the size is below it
_DATA = PAGE + _HEAD_BYTES  # place where the first payload begins
_PUT, _TAKEN, _LOST, _CLOSED, _SAID, _SAVED = range(_COUNTERS)
_TEXT = 8 * _COUNTERS


class Ring:
    """Map the ring behind file descriptor `fd`; `make_ring` makes one."""

    __slots__ = (
        "_bytes",
        "_capacity",
        "_counters",
        "_map",
        "_marked",
        "_put",
        "_taken",
        "_words",
        "fd",
        "lost",
        "missed",
    )

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self._map = mmap.mmap(fd, 0)
        self._capacity = len(self._map) - PAGE
        self._bytes = memoryview(self._map)
        self._counters = memoryview(self._map)[:_TEXT].cast("Q")
        self._words = memoryview(self._map)[PAGE:].cast("Q")
        self._put = self._counters[_PUT]
        self._taken = self._counters[_TAKEN]
        self.lost = 0  # messages that did not fit
        self._marked = 0  # of them, those that a LOST message has reported
        self.missed = 0  # messages that were lost before the one taken last

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """Append a message, or count it as lost where it does not fit; up to half the ring always fits into an empty one."""
        if self.lost > self._marked and self._place(LOST, time_ns, _U64.pack(self.lost - self._marked)):
            self._marked = self.lost
        if self.lost > self._marked or not self._place(topic, time_ns, payload):
            self.lost += 1
            self._counters[_LOST] = self.lost

    def _place(self, topic: int, time_ns: int, payload: bytes) -> bool:
        size = len(payload)
        need = (_HEAD_BYTES + size + 7) & ~7
        put, capacity, words = self._put, self._capacity, self._words
        at = put % capacity
        room = capacity - at
        whole = need if need <= room else need + room
        if put + whole - self._counters[_TAKEN] > capacity:
            return False
        if need > room:
            words[at >> 3] = SKIP
            at = 0
        words[at >> 3] = topic << _TOPIC_BITS | size
        words[(at >> 3) + 1] = time_ns
        copy_into(self._bytes, _DATA + at, payload)
        self._put = put + whole
        self._counters[_PUT] = self._put
        return True

    def take(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield (topic, time, payload) of all messages of now; each one's room is free when the next is asked for."""
        until, capacity = self._counters[_PUT], self._capacity
        while self._taken < until:
            at = self._taken % capacity
            word = self._words[at >> 3]
            size, topic = word & SKIP, word >> _TOPIC_BITS
            if size == SKIP:
                self._taken += capacity - at
                continue
            start = _DATA + at
            payload = self._map[start : start + size]
            if topic == LOST:
                self.missed += _U64.unpack(payload)[0]
            else:
                yield topic, self._words[(at >> 3) + 1], payload
            self._taken += (_HEAD_BYTES + size + 7) & ~7
            self._counters[_TAKEN] = self._taken

    @property
    def lost_there(self) -> int:
        """The reader's view of `lost`."""
        return self._counters[_LOST]

    @property
    def saved(self) -> int:
        """Messages that the reader has saved; the reader sets it."""
        return self._counters[_SAVED]

    @saved.setter
    def saved(self, messages: int) -> None:
        self._counters[_SAVED] = messages

    def finish(self) -> None:
        """Mark the end of the messages."""
        self._counters[_CLOSED] = 1

    @property
    def finished(self) -> bool:
        return bool(self._counters[_CLOSED])

    def say(self, text: str) -> None:
        """Report a trouble from the reader to the loop; the first report stays."""
        if not self._counters[_SAID]:
            words = text.encode("utf-8", "replace")[: PAGE - _TEXT]
            self._map[_TEXT : _TEXT + len(words)] = words
            self._counters[_SAID] = len(words)

    @property
    def said(self) -> str:
        """The reader's report, "" if there is none."""
        return self._map[_TEXT : _TEXT + self._counters[_SAID]].decode("utf-8", "replace")

    def close(self) -> None:
        self._bytes = self._counters = self._words = None  # type: ignore[assignment]  # else the map could not be closed
        self._map.close()
        os.close(self.fd)


def make_ring(capacity: int) -> Ring:
    """Return a ring for about `capacity` bytes of messages, without a file name. Raises OSError where there is no memory."""
    size = PAGE + (capacity + PAGE - 1) // PAGE * PAGE
    if hasattr(os, "memfd_create"):
        fd = os.memfd_create("cogrip-ring")
    else:
        with tempfile.TemporaryFile() as file:
            fd = os.dup(file.fileno())
    os.ftruncate(fd, size)
    return Ring(fd)
