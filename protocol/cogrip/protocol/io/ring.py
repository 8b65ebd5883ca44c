"""A ring of messages in shared memory: one loop puts them in, one process takes them out, neither waits for the other.

    0    u64  bytes put so far (written by the loop)
    8    u64  bytes taken so far (written by the taker)
    16   u64  messages that found no room
    24   u64  1: nothing more will come
    32   u64  length of what the taker has to say
    40   u64  messages that the taker has brought to where they should go
    48   its text
    PAGE data: u32 length, u16 topic, u16 unused, u64 time, payload; padded to 8 bytes; never across the end

A length of SKIP says: go on at the start. Both counters only grow, and each has one writer; a message's bytes are there
before its counter says so.
"""

import mmap
import os
import tempfile
from collections.abc import Iterator
from struct import Struct

PAGE = 4096
SKIP = 0xFFFF_FFFF
_U64 = Struct("<Q")
_HEAD = Struct("<IHHQ")
_PUT, _TAKEN, _LOST, _CLOSED, _SAID, _SAVED, _TEXT = 0, 8, 16, 24, 32, 40, 48


class Ring:
    """Map the ring behind file descriptor `fd`; `make_ring` makes one."""

    __slots__ = ("_capacity", "_map", "_put", "_taken", "fd", "lost")

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self._map = mmap.mmap(fd, 0)
        self._capacity = len(self._map) - PAGE
        self._put = self._read(_PUT)
        self._taken = self._read(_TAKEN)
        self.lost = 0  # messages that found no room

    def _read(self, at: int) -> int:
        value: int = _U64.unpack_from(self._map, at)[0]
        return value

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """A message, or one more lost where there is no room."""
        size = len(payload)
        need = (_HEAD.size + size + 7) & ~7
        put, capacity = self._put, self._capacity
        at = put % capacity
        room = capacity - at
        whole = need if need <= room else need + room
        if put + whole - self._read(_TAKEN) > capacity:
            self.lost += 1
            _U64.pack_into(self._map, _LOST, self.lost)
            return
        if need > room:
            _HEAD.pack_into(self._map, PAGE + at, SKIP, 0, 0, 0) if room >= _HEAD.size else None
            at = 0
        _HEAD.pack_into(self._map, PAGE + at, size, topic, 0, time_ns)
        start = PAGE + at + _HEAD.size
        self._map[start : start + size] = payload
        self._put = put + whole
        _U64.pack_into(self._map, _PUT, self._put)

    def take(self) -> Iterator[tuple[int, int, bytes]]:
        """(topic, time, payload) of all that is there now; each is free again when the next is asked for."""
        until, capacity = self._read(_PUT), self._capacity
        while self._taken < until:
            at = self._taken % capacity
            room = capacity - at
            size, topic, _, time_ns = _HEAD.unpack_from(self._map, PAGE + at) if room >= _HEAD.size else (SKIP, 0, 0, 0)
            if size == SKIP:
                self._taken += room
                continue
            start = PAGE + at + _HEAD.size
            yield topic, time_ns, self._map[start : start + size]
            self._taken += (_HEAD.size + size + 7) & ~7
            _U64.pack_into(self._map, _TAKEN, self._taken)

    @property
    def lost_there(self) -> int:
        """The taker's view of `lost`."""
        return self._read(_LOST)

    @property
    def saved(self) -> int:
        """Messages that the taker has brought to where they should go; the taker sets it."""
        return self._read(_SAVED)

    @saved.setter
    def saved(self, messages: int) -> None:
        _U64.pack_into(self._map, _SAVED, messages)

    def finish(self) -> None:
        """Say that nothing more will come."""
        _U64.pack_into(self._map, _CLOSED, 1)

    @property
    def finished(self) -> bool:
        return bool(self._read(_CLOSED))

    def say(self, text: str) -> None:
        """The taker's words to the loop; the first ones stay."""
        if not self._read(_SAID):
            words = text.encode("utf-8", "replace")[: PAGE - _TEXT]
            self._map[_TEXT : _TEXT + len(words)] = words
            _U64.pack_into(self._map, _SAID, len(words))

    @property
    def said(self) -> str:
        length = self._read(_SAID)
        return self._map[_TEXT : _TEXT + length].decode("utf-8", "replace") if length else ""

    def close(self) -> None:
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
