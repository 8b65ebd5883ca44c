"""Classic BPF program that finds a peer's socket among those that share the public port (Linux, SO_ATTACH_REUSEPORT_CBPF).

It hashes source address and port of a datagram, looks the hash up in a sorted list, and returns the place of a socket in the
group: 0, the front, for whoever is not in the list. Two peers may have the same hash: a receiver has to look at the sender.
"""

import socket
import struct
from collections.abc import Iterator, Mapping, Sequence

from cogrip.server.hosting.link import PeerAddress

LEAF = 4  # most peers that are compared one by one
MASK = 0x7FFFFFFF  # mask of 31 bits: the kernel takes another instruction for a constant of 32

_NET = 0xFFF00000  # SKF_NET_OFF: offset from which on the network header is read
_LOAD_WORD, _LOAD_HALF, _LOAD_BYTE = 0x20, 0x28, 0x30  # BPF_LD | BPF_ABS
_MULTIPLY, _ADD_X, _AND, _SHIFT, _XOR_X = 0x24, 0x0C, 0x54, 0x74, 0xAC  # BPF_ALU, by the constant or X
_EQUAL, _GREATER, _JUMP = 0x15, 0x25, 0x05  # BPF_JMP
_RETURN, _TO_X = 0x06, 0x07  # BPF_RET, BPF_MISC | BPF_TAX

_IPV4 = (0x45, (12,), 20)
"""First byte of a header without options; words of the source address; place of the source port."""
_IPV6 = (0x60, (8, 12, 16, 20), 40)
_NEXT_HEADER, _UDP = 6, 17

Instruction = tuple[int, int, int, int]
"""Code, steps to skip where it is true, steps to skip where it is false, constant."""


def hash_of(address: PeerAddress, multiplier: int) -> int:
    """Return the hash of a peer's address, as sockets give it. Raises OSError where its host is no number.

    multiplier: odd, 32 bits, the program's; where it is secret nobody can look for an address with the hash of another one
    """
    host = str(address[0]).partition("%")[0]
    if ":" in host:
        packed = socket.inet_pton(socket.AF_INET6, host)
        if packed.startswith(bytes(10) + b"\xff\xff"):
            packed = packed[12:]  # IPv4, at a socket of both
    else:
        packed = socket.inet_pton(socket.AF_INET, host)
    found = 0
    for word in (*struct.unpack(f"!{len(packed) // 4}I", packed), int(address[1])):
        found = (found + word) * multiplier & 0xFFFFFFFF
        found ^= found >> 16  # or one bit of two words would leave it as it is, whatever the multiplier
    return found & MASK


def program(places: Mapping[int, int], multiplier: int) -> list[Instruction]:
    """Return the program for these places in the group, by hash."""
    search = list(_search(sorted(places.items())))
    ipv4, ipv6 = list(_hash(*_IPV4[1:], multiplier)), list(_hash(*_IPV6[1:], multiplier))
    other = [(_EQUAL, 1, 0, _UDP), (_RETURN, 0, 0, 0)]  # behind extension headers the port is elsewhere
    ipv6 = [(_LOAD_BYTE, 0, 0, _NET + _NEXT_HEADER), *other, *ipv6]
    return [
        (_LOAD_BYTE, 0, 0, _NET),
        (_EQUAL, 0, len(ipv4) + 1, _IPV4[0]),
        *ipv4,
        (_JUMP, 0, 0, len(ipv6) + 3),
        (_AND, 0, 0, 0xF0),
        (_EQUAL, 1, 0, _IPV6[0]),
        (_RETURN, 0, 0, 0),
        *ipv6,
        *search,
    ]


def _hash(words: Sequence[int], port: int, multiplier: int) -> Iterator[Instruction]:
    for number, (code, place) in enumerate([*((_LOAD_WORD, word) for word in words), (_LOAD_HALF, port)]):
        if number:
            yield _TO_X, 0, 0, 0
        yield code, 0, 0, _NET + place
        if number:
            yield _ADD_X, 0, 0, 0
        yield _MULTIPLY, 0, 0, multiplier
        yield _TO_X, 0, 0, 0
        yield _SHIFT, 0, 0, 16
        yield _XOR_X, 0, 0, 0
    yield _AND, 0, 0, MASK


def _search(entries: Sequence[tuple[int, int]]) -> Iterator[Instruction]:
    """Yield a binary search of A among sorted (hash, place)."""
    if len(entries) <= LEAF:
        for found, place in entries:
            yield _EQUAL, 0, 1, found
            yield _RETURN, 0, 0, place
        yield _RETURN, 0, 0, 0
        return
    half = len(entries) // 2
    below = list(_search(entries[:half]))
    yield _GREATER, 0, 1, entries[half - 1][0]
    yield _JUMP, 0, 0, len(below)  # a comparison skips 255 steps at most
    yield from below
    yield from _search(entries[half:])
