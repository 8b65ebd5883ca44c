"""Both ends of a connection of the administration interface, without their sockets (h11): bytes in, bytes out.

A connection carries one request, and an answer or a stream of events: whoever asks again connects again, so that nobody keeps
a place without asking.
"""

from typing import Any, NamedTuple

import h11
import msgspec

from cogrip.server.administration.operations import AskedOrder, EventFilter, request_of
from cogrip.server.administration.orders import OrderReply
from cogrip.server.events import ServerEvent

MOST_HEAD_BYTES = 8192  # most bytes of a request's head
MOST_BODY_BYTES = 4096
MOST_ANSWER_BYTES = 65536
_JSON = (b"content-type", b"application/json")
_STREAM = (b"content-type", b"text/event-stream")


class HttpRequest(NamedTuple):
    """One request, whole."""

    method: str
    target: str
    body: bytes


class RefusedError(ValueError):
    """Bytes that are no request. reason: name under which it is counted; status: of HTTP."""

    def __init__(self, reason: str, text: str, status: int) -> None:
        super().__init__(text)
        self.reason, self.status = reason, status


class HttpCaller:
    """Server's end of a connection."""

    def __init__(self) -> None:
        self._http = h11.Connection(h11.SERVER, max_incomplete_event_size=MOST_HEAD_BYTES)
        self._head: h11.Request | None = None
        self._body = b""

    def receive(self, data: bytes) -> HttpRequest | None:
        """Take in bytes, b"" for the end; return the request once it is whole. Raises RefusedError."""
        try:
            self._http.receive_data(data)
            while (event := self._http.next_event()) not in (h11.NEED_DATA, h11.PAUSED):
                if isinstance(event, h11.Request):
                    self._head = event
                elif isinstance(event, h11.Data):
                    self._body += bytes(event.data)
                    if len(self._body) > MOST_BODY_BYTES:
                        raise RefusedError("too long", f"a body may have {MOST_BODY_BYTES} bytes", 413)
                elif isinstance(event, h11.EndOfMessage) and self._head is not None:
                    head = self._head
                    return HttpRequest(head.method.decode("ascii"), head.target.decode("ascii"), self._body)
                elif isinstance(event, h11.ConnectionClosed):
                    raise RefusedError("cut short", "nothing was asked", 400)
        except h11.RemoteProtocolError as error:
            if not data:
                raise RefusedError("cut short", "the request was cut short", 400) from None
            reason = "too long" if error.error_status_hint == 431 else "malformed"
            raise RefusedError(reason, f"that is no request: {error}", error.error_status_hint) from None
        return None

    def answer(self, status: int, value: Any, place: str = "") -> bytes:
        """Return the bytes of an answer. place: where what was asked for is instead."""
        body = msgspec.json.encode(value)
        if len(body) > MOST_ANSWER_BYTES:
            status, text = 500, f"the answer would have {len(body)} bytes, too many"
            body = msgspec.json.encode({"ok": False, "text": text})
        headers = [_JSON, (b"content-length", b"%d" % len(body)), (b"connection", b"close")]
        if place:
            headers.append((b"location", place.encode("ascii")))
        return self._send(h11.Response(status_code=status, headers=headers), h11.Data(data=body), h11.EndOfMessage())

    def begin_stream(self) -> bytes:
        """Return the bytes with which a stream of events begins."""
        return self._send(h11.Response(status_code=200, headers=[_STREAM, (b"cache-control", b"no-store")]), alive())

    def event(self, number: int, event: ServerEvent) -> bytes:
        """Return the bytes of one event."""
        parts = number, event.event.encode(), msgspec.json.encode(event)
        return self._send(h11.Data(data=b"id: %d\nevent: %s\ndata: %s\n\n" % parts))

    def alive(self) -> bytes:
        """Return the bytes of a comment: whoever is gone is found out."""
        return self._send(alive())

    def _send(self, *events: h11.Event) -> bytes:
        try:
            return b"".join([self._http.send(event) or b"" for event in events])
        except h11.LocalProtocolError:  # to bytes that were no request
            return b""


def alive() -> h11.Data:
    """Return a comment of a stream."""
    return h11.Data(data=b": alive\n\n")


class HttpAsker:
    """Client's end of a connection.

    request  bytes to send first
    ended    whether nothing more comes
    """

    def __init__(self, asked: AskedOrder | EventFilter) -> None:
        self._http = h11.Connection(h11.CLIENT)
        method, target, body = request_of(asked)
        headers = [("host", "cogrip"), ("content-length", f"{len(body)}"), ("content-type", "application/json")]
        events = h11.Request(method=method, target=target, headers=headers), h11.Data(data=body), h11.EndOfMessage()
        self.request = b"".join([self._http.send(event) or b"" for event in events])
        self.ended = False
        self._body = b""
        self._streams = isinstance(asked, EventFilter)
        self._refused = False

    def receive(self, data: bytes) -> list[tuple[int, ServerEvent]]:
        """Take in bytes, b"" for the end; return the events in them, each with its number. Raises ValueError for no answer."""
        try:
            self._http.receive_data(data)
            while (event := self._http.next_event()) is not h11.NEED_DATA:
                if isinstance(event, h11.Response):
                    self._refused = event.status_code != 200
                elif isinstance(event, h11.Data):
                    self._body += bytes(event.data)
                    if len(self._body) > 2 * MOST_ANSWER_BYTES:
                        raise ValueError("the answer is too long")
                elif isinstance(event, h11.EndOfMessage | h11.ConnectionClosed) or event is h11.PAUSED:
                    self.ended = True
                    break
        except h11.RemoteProtocolError as error:
            raise ValueError(str(error)) from None
        return self._events() if self._streams and not self._refused else []

    def reply(self) -> OrderReply:
        """Return the answer. Raises ValueError (msgspec.DecodeError) for what is none."""
        return msgspec.json.decode(self._body, type=OrderReply)

    def _events(self) -> list[tuple[int, ServerEvent]]:
        *whole, self._body = self._body.split(b"\n\n")
        parts = [each.split(b"\n") for each in whole if each.startswith(b"id: ")]
        return [(int(first[4:]), msgspec.json.decode(last[6:], type=ServerEvent)) for first, *_, last in parts]
