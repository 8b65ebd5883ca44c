"""A ring of messages in shared memory: one loop puts them in, one process takes them out, neither waits for the other.

    0    u64  bytes put so far (written by the loop)
    8    u64  bytes taken so far (written by the taker)
    16   u64  messages that found no room
    24   u64  1: nothing more will come
    32   u64  length of what the taker has to say
    40   u64  messages that the taker has brought to where they should go
    48   its text
    PAGE data: u32 length, u16 topic, u16 unused, u64 time, payload; padded to 8 bytes; never across the end

A length of SKIP says: go on at the start. Topic LOST is the ring's own: so many messages (u64) found no room just here.
Both counters only grow, and each has one writer; a message's bytes are there before its counter says so. Counters are
items of a cast view, stored all eight bytes at once: `struct` zeroes before it packs, and the other side would see that.
"""

import mmap
import os
import tempfile
from collections.abc import Iterator
from struct import Struct

PAGE = 4096
SKIP = 0xFFFF_FFFF
LOST = 0xFFFF
_U64 = Struct("Q")
_COUNTERS = 6
_HEAD = Struct("<IHHQ")
_PUT, _TAKEN, _LOST, _CLOSED, _SAID, _SAVED = range(_COUNTERS)
_TEXT = 8 * _COUNTERS


class Ring:
    """Map the ring behind file descriptor `fd`; `make_ring` makes one."""

    __slots__ = ("_capacity", "_counters", "_map", "_marked", "_put", "_taken", "fd", "lost", "missed")

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self._map = mmap.mmap(fd, 0)
        self._capacity = len(self._map) - PAGE
        self._counters = memoryview(self._map)[:_TEXT].cast("Q")
        self._put = self._counters[_PUT]
        self._taken = self._counters[_TAKEN]
        self.lost = 0  # messages that found no room
        self._marked = 0  # of them, those that LOST has told of
        self.missed = 0  # messages that were lost before the one taken last

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """A message, or one more lost where there is no room; one of up to half the ring always fits an empty one."""
        if self.lost > self._marked and self._place(LOST, time_ns, _U64.pack(self.lost - self._marked)):
            self._marked = self.lost
        if self.lost > self._marked or not self._place(topic, time_ns, payload):
            self.lost += 1
            self._counters[_LOST] = self.lost

    def _place(self, topic: int, time_ns: int, payload: bytes) -> bool:
        size = len(payload)
        need = (_HEAD.size + size + 7) & ~7
        put, capacity = self._put, self._capacity
        at = put % capacity
        room = capacity - at
        whole = need if need <= room else need + room
        if put + whole - self._counters[_TAKEN] > capacity:
            return False
        if need > room:
            _HEAD.pack_into(self._map, PAGE + at, SKIP, 0, 0, 0) if room >= _HEAD.size else None
            at = 0
        _HEAD.pack_into(self._map, PAGE + at, size, topic, 0, time_ns)
        start = PAGE + at + _HEAD.size
        self._map[start : start + size] = payload
        self._put = put + whole
        self._counters[_PUT] = self._put
        return True

    def take(self) -> Iterator[tuple[int, int, bytes]]:
        """(topic, time, payload) of all that is there now; each is free again when the next is asked for."""
        until, capacity = self._counters[_PUT], self._capacity
        while self._taken < until:
            at = self._taken % capacity
            room = capacity - at
            size, topic, _, time_ns = _HEAD.unpack_from(self._map, PAGE + at) if room >= _HEAD.size else (SKIP, 0, 0, 0)
            if size == SKIP:
                self._taken += room
                continue
            start = PAGE + at + _HEAD.size
            payload = self._map[start : start + size]
            if topic == LOST:
                self.missed += _U64.unpack(payload)[0]
            else:
                yield topic, time_ns, payload
            self._taken += (_HEAD.size + size + 7) & ~7
            self._counters[_TAKEN] = self._taken

    @property
    def lost_there(self) -> int:
        """The taker's view of `lost`."""
        return self._counters[_LOST]

    @property
    def saved(self) -> int:
        """Messages that the taker has brought to where they should go; the taker sets it."""
        return self._counters[_SAVED]

    @saved.setter
    def saved(self, messages: int) -> None:
        self._counters[_SAVED] = messages

    def finish(self) -> None:
        """Say that nothing more will come."""
        self._counters[_CLOSED] = 1

    @property
    def finished(self) -> bool:
        return bool(self._counters[_CLOSED])

    def say(self, text: str) -> None:
        """The taker's words to the loop; the first ones stay."""
        if not self._counters[_SAID]:
            words = text.encode("utf-8", "replace")[: PAGE - _TEXT]
            self._map[_TEXT : _TEXT + len(words)] = words
            self._counters[_SAID] = len(words)

    @property
    def said(self) -> str:
        length = self._counters[_SAID]
        return self._map[_TEXT : _TEXT + length].decode("utf-8", "replace") if length else ""

    def close(self) -> None:
        self._counters.release()
        self._map.close()
        os.close(self.fd)


def make_ring(capacity: int) -> Ring:
    """A ring for about `capacity` bytes of messages that no folder names. Raises OSError where there is no memory."""
    size = PAGE + (capacity + PAGE - 1) // PAGE * PAGE
    if hasattr(os, "memfd_create"):
        fd = os.memfd_create("cogrip-ring")
    else:
        with tempfile.TemporaryFile() as file:
            fd = os.dup(file.fileno())
    os.ftruncate(fd, size)
    return Ring(fd)
