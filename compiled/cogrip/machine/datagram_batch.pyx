"""Datagrams of an IPv4 or IPv6 socket, many in a system call (Linux: recvmmsg, sendmmsg): `Datagrams` and `Arrivals`, compiled.

Addresses are tuples as Python's sockets give them, each made once: equal sockaddrs give the same tuple.
"""

from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_FromStringAndSize, PyBytes_GET_SIZE
from libc.errno cimport EAGAIN, EINTR, errno
from libc.stdlib cimport calloc, free
from libc.string cimport memcmp, memcpy

import os
import socket
import sys

cdef extern from "<sys/socket.h>" nogil:
    ctypedef unsigned int socklen_t
    cdef struct iovec:
        void *iov_base
        size_t iov_len
    cdef struct msghdr:
        void *msg_name
        socklen_t msg_namelen
        iovec *msg_iov
        size_t msg_iovlen
        void *msg_control
        size_t msg_controllen
        int msg_flags
    cdef struct cmsghdr:
        size_t cmsg_len
        int cmsg_level
        int cmsg_type
    cdef struct mmsghdr:
        msghdr msg_hdr
        unsigned int msg_len
    cmsghdr *CMSG_FIRSTHDR(msghdr *)
    cmsghdr *CMSG_NXTHDR(msghdr *, cmsghdr *)
    unsigned char *CMSG_DATA(cmsghdr *)
    ssize_t recvmsg(int, msghdr *, int)
    int recvmmsg(int, mmsghdr *, unsigned int, int, void *)
    int sendmmsg(int, mmsghdr *, unsigned int, int)
    int SOL_SOCKET, MSG_DONTWAIT

cdef extern from "<time.h>" nogil:
    cdef struct timespec:
        long tv_sec
        long tv_nsec
    int clock_gettime(int, timespec *)
    int CLOCK_REALTIME, CLOCK_MONOTONIC

cdef enum:
    MOST = 64  # datagrams in a system call
    BUFFER = 1280  # bytes of one, at least one more than may come
    NAME = 28  # of a sockaddr_in6
    CONTROL = 64
    CONTROL_WORDS = 8  # of eight bytes
    SO_TIMESTAMPNS = 35
    MOST_KNOWN = 4096  # addresses that are kept: a flood from forged ones takes no more memory


cdef long long _now_ns(int clock):
    cdef timespec now
    clock_gettime(clock, &now)
    return now.tv_sec * 1000000000LL + now.tv_nsec


cdef long long _utc_offset_ns():
    """Return what is added to the kernel's stamps, which are UTC."""
    return _now_ns(CLOCK_MONOTONIC) - _now_ns(CLOCK_REALTIME)


cdef long long _arrived_ns(msghdr *taken, long long offset_ns, long long newest_ns, long long now_ns):
    """Return when a datagram came: not after now, and not before the newest one."""
    cdef timespec stamp
    cdef long long arrived_ns
    cdef cmsghdr *said = CMSG_FIRSTHDR(taken)
    while said != NULL:
        if said.cmsg_level == SOL_SOCKET and said.cmsg_type == SO_TIMESTAMPNS:
            memcpy(&stamp, CMSG_DATA(said), sizeof(timespec))
            arrived_ns = stamp.tv_sec * 1000000000LL + stamp.tv_nsec + offset_ns
            if arrived_ns < newest_ns:
                arrived_ns = newest_ns
            return now_ns if arrived_ns > now_ns else arrived_ns
        said = CMSG_NXTHDR(taken, said)
    return -1


cdef tuple _address_of(bytes name):
    """Return the address in a sockaddr, as Python's sockets give it."""
    family = int.from_bytes(name[:2], sys.byteorder)
    port = int.from_bytes(name[2:4], "big")
    if family == socket.AF_INET:
        return socket.inet_ntop(socket.AF_INET, name[4:8]), port
    flow, scope = int.from_bytes(name[4:8], "big"), int.from_bytes(name[24:28], sys.byteorder)
    return socket.inet_ntop(socket.AF_INET6, name[8:24]), port, flow, scope


cdef bytes _sockaddr_of(family, tuple address):
    """Return the sockaddr of an address. Raises OSError where its host is no plain number."""
    begin = int(family).to_bytes(2, sys.byteorder) + int(address[1]).to_bytes(2, "big")
    if family == socket.AF_INET:
        return begin + socket.inet_pton(socket.AF_INET, address[0]) + bytes(8)
    host, _, flow, scope = address
    place = socket.inet_pton(socket.AF_INET6, host)
    return begin + int(flow).to_bytes(4, "big") + place + int(scope).to_bytes(4, sys.byteorder)


cdef msghdr _message  # of every `BatchArrivals`: one datagram is received at a time, and these bytes are in the cache
cdef iovec _part
cdef unsigned long long[CONTROL_WORDS] _control  # aligned as its headers are
cdef unsigned char[BUFFER] _buffer
cdef unsigned char[NAME] _name

_part.iov_base = _buffer
_part.iov_len = BUFFER
_message.msg_iov = &_part
_message.msg_iovlen = 1
_message.msg_name = _name
_message.msg_control = _control


cdef class BatchArrivals:
    """Receiving end of a socket that has few peers. Everything is as `Arrivals` has it."""

    cdef object _socket
    cdef int _fd
    cdef long long _newest_ns
    cdef bytes _known  # sockaddr of the newest sender
    cdef tuple _address

    def __cinit__(self, own):
        self._socket, self._fd = own, own.fileno()
        self._newest_ns = 0
        self._known, self._address = b"", ()
        own.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)

    cpdef tuple receive(self, Py_ssize_t most_bytes, long long now_ns):
        """Return a datagram, its sender, and when it came. Raises BlockingIOError where there is none, OSError."""
        found = self.poll(most_bytes, now_ns)
        if found is None:
            raise BlockingIOError
        return found

    cpdef tuple poll(self, Py_ssize_t most_bytes, long long now_ns):
        """Return what `receive` does, None where there is nothing."""
        cdef Py_ssize_t size
        while True:
            _message.msg_namelen = NAME
            _message.msg_controllen = CONTROL
            size = recvmsg(self._fd, &_message, MSG_DONTWAIT)
            if size >= 0 or errno != EINTR:
                break
        if size < 0 and errno == EAGAIN:
            return None
        if size < 0:
            raise OSError(errno, os.strerror(errno))
        cdef Py_ssize_t named = _message.msg_namelen
        if named != PyBytes_GET_SIZE(self._known) or memcmp(_name, PyBytes_AS_STRING(self._known), named):
            self._known = PyBytes_FromStringAndSize(<char *>_name, named)
            self._address = _address_of(self._known)
        cdef long long arrived_ns = _arrived_ns(&_message, _utc_offset_ns(), self._newest_ns, now_ns)
        if arrived_ns < 0:
            arrived_ns = now_ns
        else:
            self._newest_ns = arrived_ns
        return PyBytes_FromStringAndSize(<char *>_buffer, min(size, most_bytes)), self._address, arrived_ns


cdef class DatagramBatch:
    """Both directions of one socket. Everything is as `Datagrams` has it."""

    cdef object _socket
    cdef int _fd
    cdef mmsghdr *_in
    cdef mmsghdr *_out
    cdef iovec *_parts
    cdef unsigned char *_buffers
    cdef unsigned char *_names
    cdef unsigned char *_controls
    cdef int _at, _count
    cdef long long _newest_ns, _offset_ns
    cdef dict _addresses  # sockaddr -> tuple
    cdef dict _sockaddrs

    def __cinit__(self, own):
        self._in = <mmsghdr *>calloc(MOST, sizeof(mmsghdr))
        self._out = <mmsghdr *>calloc(MOST, sizeof(mmsghdr))
        self._parts = <iovec *>calloc(2 * MOST, sizeof(iovec))
        self._buffers = <unsigned char *>calloc(MOST, BUFFER)
        self._names = <unsigned char *>calloc(MOST, NAME)
        self._controls = <unsigned char *>calloc(MOST, CONTROL)
        if not (self._in and self._out and self._parts and self._buffers and self._names and self._controls):
            raise MemoryError
        self._socket, self._fd = own, own.fileno()
        self._at = self._count = 0
        self._newest_ns = self._offset_ns = 0
        self._addresses, self._sockaddrs = {}, {}
        cdef int place
        for place in range(MOST):
            self._parts[place].iov_base = self._buffers + place * BUFFER
            self._parts[place].iov_len = BUFFER
            self._in[place].msg_hdr.msg_iov = self._parts + place
            self._in[place].msg_hdr.msg_iovlen = 1
            self._in[place].msg_hdr.msg_name = self._names + place * NAME
            self._in[place].msg_hdr.msg_control = self._controls + place * CONTROL
            self._out[place].msg_hdr.msg_iov = self._parts + MOST + place
            self._out[place].msg_hdr.msg_iovlen = 1
        own.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)

    def __dealloc__(self):
        free(self._in)
        free(self._out)
        free(self._parts)
        free(self._buffers)
        free(self._names)
        free(self._controls)

    cpdef tuple receive(self, Py_ssize_t most_bytes, long long now_ns):
        """Return a datagram, its sender, and when it came. Raises BlockingIOError where there is none, OSError."""
        if self._at == self._count:
            self._fill()
        cdef mmsghdr *taken = self._in + self._at
        cdef Py_ssize_t size = taken.msg_len
        self._at += 1
        if size > most_bytes:
            size = most_bytes
        cdef bytes name = PyBytes_FromStringAndSize(<char *>taken.msg_hdr.msg_name, taken.msg_hdr.msg_namelen)
        cdef bytes datagram = PyBytes_FromStringAndSize(<char *>taken.msg_hdr.msg_iov.iov_base, size)
        address = self._addresses.get(name)
        if address is None:
            address = self._meet(name)
        cdef long long arrived_ns = _arrived_ns(&taken.msg_hdr, self._offset_ns, self._newest_ns, now_ns)
        if arrived_ns < 0:
            arrived_ns = now_ns
        else:
            self._newest_ns = arrived_ns
        return datagram, address, arrived_ns

    cdef int _fill(self) except -1:
        cdef int place, count
        for place in range(MOST):
            self._in[place].msg_hdr.msg_namelen = NAME
            self._in[place].msg_hdr.msg_controllen = CONTROL
        while True:
            count = recvmmsg(self._fd, self._in, MOST, MSG_DONTWAIT, NULL)
            if count >= 0 or errno != EINTR:
                break
        self._at = 0
        self._count = count if count > 0 else 0
        if count < 0 and errno == EAGAIN:
            raise BlockingIOError
        if count < 0:
            raise OSError(errno, os.strerror(errno))
        self._offset_ns = _utc_offset_ns()
        return 0

    cdef tuple _meet(self, bytes name):
        cdef tuple address = _address_of(name)
        self._keep(name, address)
        return address

    cdef _keep(self, bytes name, address):
        if len(self._sockaddrs) >= MOST_KNOWN:
            self._addresses.clear()
            self._sockaddrs.clear()
        self._addresses[name] = address
        self._sockaddrs[address] = name

    cdef bytes _name_of(self, address):
        """Return the sockaddr of an address, None where only the system can make one of it."""
        cdef bytes name = self._sockaddrs.get(address)
        if name is None:  # nothing came from there, or it was forgotten
            try:
                name = _sockaddr_of(self._socket.family, address)
            except (OSError, ValueError, TypeError, OverflowError):
                return None
            self._keep(name, address)
        return name

    cpdef list send_all(self, outbox):
        """Send all (address, datagram) of a queue, and return what was refused, and why."""
        cdef list refused = []
        cdef list held = []
        cdef bytes datagram, name
        cdef int count, done, sent
        while outbox:
            count = 0
            held.clear()
            while outbox and count < MOST:
                address, datagram = outbox.popleft()
                if datagram is None:
                    raise TypeError("a datagram is None")
                name = self._name_of(address)
                if name is None:
                    try:
                        self._socket.sendto(datagram, address)
                    except OSError as error:
                        refused.append(str(error.strerror))
                    except (OverflowError, TypeError, ValueError) as error:
                        refused.append(f"{address!r} is no address: {error}")
                    continue
                held.append((name, datagram))
                self._out[count].msg_hdr.msg_name = PyBytes_AS_STRING(name)
                self._out[count].msg_hdr.msg_namelen = <socklen_t>PyBytes_GET_SIZE(name)
                self._parts[MOST + count].iov_base = PyBytes_AS_STRING(datagram)
                self._parts[MOST + count].iov_len = PyBytes_GET_SIZE(datagram)
                count += 1
            done = 0
            while done < count:
                sent = sendmmsg(self._fd, self._out + done, count - done, MSG_DONTWAIT)
                if sent > 0:
                    done += sent
                elif sent < 0 and errno == EINTR:
                    continue
                else:  # the first of the rest is refused
                    refused.append(os.strerror(errno))
                    done += 1
        return refused
