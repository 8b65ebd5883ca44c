"""Operations of the administration interface: which request is which order, and the OpenAPI document that says so.

Version 1, HTTP with JSON (docs/administration.md). Paths and fields stay as they are; what is new gets a new name.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

import msgspec

from cogrip.protocol.settings.hand import parsed
from cogrip.protocol.settings.settable import NOT_SETTABLE, PERSON, ROOM, room_change
from cogrip.server.administration.orders import (
    AnyOrder,
    CloseRoomOrder,
    DrainOrder,
    KickOrder,
    MarkOrder,
    NewRoomOrder,
    OrderReply,
    ReloadOrder,
    SetHandOrder,
    SetRoomOrder,
    StatusOrder,
    WhoOrder,
    Word,
)
from cogrip.server.events import EVENTS, ServerEvent

API = "/v1"
OPENAPI, SETTABLE, EVENT_STREAM, METRICS = f"{API}/openapi.json", f"{API}/settable", f"{API}/events", f"{API}/metrics"


class SetBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Change of settings by their keys, as `cogrip set` has them: of a person (`user`), or of a room."""

    values: Mapping[str, str | int | float | bool | list[float]]
    user: Word = ""  # name of the seat; "" changes the room
    room: Word = ""

    @property
    def order(self) -> SetHandOrder | SetRoomOrder:
        """Return the order. Raises ValueError, which names key, value, bound and cure."""
        pairs = [f"{key}={_text(value)}" for key, value in self.values.items()]
        if self.user:
            return SetHandOrder(self.user, parsed(pairs), self.room)
        return SetRoomOrder(room_change(pairs), self.room)


class EventFilter(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Events that a stream has: of this room, of this kind; all where neither is given.

    after: number of an event from which the stream goes on, as far as the server still has those after it; 0: from its first
    one; -1: only those to come
    """

    room: Word = ""
    event: Word = ""
    after: int = -1

    def takes(self, event: ServerEvent) -> bool:
        """Return whether the stream has this event. What is of no room is in the streams of all."""
        return event.room in ("", self.room or event.room) and self.event in ("", event.event)


class Operation(NamedTuple):
    """One operation. takes: fields of the query (GET), or of the body (POST)."""

    method: str
    path: str
    takes: type[msgspec.Struct]
    summary: str


OPERATIONS = (
    Operation("GET", f"{API}/status", StatusOrder, "Uptime, rooms with their objects, and what cannot be written now"),
    Operation("GET", f"{API}/people", WhoOrder, "Everybody who is seated or observes"),
    Operation("POST", f"{API}/set", SetBody, "Change settings of a person or of a room, ramped, recorded and marked"),
    Operation("POST", f"{API}/mark", MarkOrder, "Set a marker in every recording of the session"),
    Operation("POST", f"{API}/kick", KickOrder, "End somebody's sessions"),
    Operation("POST", f"{API}/rooms", NewRoomOrder, "Open a spare room of a template, under a name"),
    Operation("DELETE", f"{API}/rooms", CloseRoomOrder, "Close a room that was opened on demand"),
    Operation("POST", f"{API}/reload", ReloadOrder, "Read the tokens again"),
    Operation("POST", f"{API}/drain", DrainOrder, "Let the rooms of a host of the cluster move to others"),
)
AskedOrder = (
    KickOrder | MarkOrder | SetBody | NewRoomOrder | CloseRoomOrder | ReloadOrder | StatusOrder | WhoOrder | DrainOrder
)
"""Order as whoever asks has it."""
QUERIED = ("GET", "DELETE")  # methods whose fields are in the query
_BY_PLACE = {(each.method, each.path): each for each in OPERATIONS}
_PLAIN = (OPENAPI, SETTABLE, EVENT_STREAM, METRICS)


class Answer(NamedTuple):
    """Answer that needs no server: status and JSON value."""

    status: int
    value: Any


class UnknownError(ValueError):
    """There is no such operation. status: of HTTP, 404 or 405."""

    def __init__(self, text: str, status: int) -> None:
        super().__init__(text)
        self.status = status


def order_of(method: str, target: str, body: bytes) -> AnyOrder | EventFilter | Answer:
    """Return what a request asks for. Raises UnknownError, ValueError (msgspec.DecodeError among them)."""
    parts = urlsplit(target)
    query = dict(parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query)))
    if method == "GET" and parts.path in _PLAIN:
        if parts.path == EVENT_STREAM:
            return msgspec.convert(query, EventFilter, strict=False)
        return Answer(200, openapi() if parts.path == OPENAPI else settable())
    operation = _BY_PLACE.get((method, parts.path))
    if operation is None:
        raise _unknown(method, parts.path)
    if method in QUERIED:
        given = msgspec.convert(query, operation.takes, strict=False)
    else:
        given = msgspec.json.decode(body or b"{}", type=operation.takes)
    return given.order if isinstance(given, SetBody) else given  # type: ignore[return-value]  # the table has orders


def _unknown(method: str, path: str) -> UnknownError:
    known = [each.method for each in OPERATIONS if each.path == path] or (["GET"] if path in _PLAIN else [])
    if known:
        return UnknownError(f"{path} takes {' or '.join(known)}, not {method}", 405)
    paths = ", ".join([*_PLAIN, *[each.path for each in OPERATIONS]])
    return UnknownError(f"there is no {path}; there is: {paths}", 404)


def request_of(order: AskedOrder | EventFilter) -> tuple[str, str, bytes]:
    """Return method, target and body of the request that is this order."""
    if isinstance(order, EventFilter):
        return "GET", _target(EVENT_STREAM, order), b""
    operation = next(each for each in OPERATIONS if each.takes is type(order))
    if operation.method in QUERIED:
        return operation.method, _target(operation.path, order), b""
    body = msgspec.to_builtins(order)
    body.pop("verb", None)
    return operation.method, operation.path, msgspec.json.encode(body)


def _target(path: str, fields: msgspec.Struct) -> str:
    given = {
        name: value for name, value in msgspec.structs.asdict(fields).items() if value != "" and value is not False
    }
    return f"{path}?{urlencode(given, quote_via=quote)}" if given else path


def settable() -> dict[str, Any]:
    """Return what can be set in a session, and why the rest cannot."""
    rows = {name: [row._asdict() for row in rows] for name, rows in (("person", PERSON), ("room", ROOM))}
    return {**rows, "not_settable": dict(NOT_SETTABLE)}


def openapi() -> dict[str, Any]:
    """Return the OpenAPI document of the interface."""
    bodies = [each.takes for each in OPERATIONS]
    shapes, components = msgspec.json.schema_components(
        [*bodies, OrderReply, EventFilter, ServerEvent], ref_template="#/components/schemas/{name}"
    )
    for name in {each.__name__ for each in bodies} & components.keys():
        components[name]["properties"].pop("verb", None)
        components[name]["required"] = [each for each in components[name].get("required", ()) if each != "verb"]
        if not components[name]["required"]:
            del components[name]["required"]
    reply = {"content": {"application/json": {"schema": shapes[len(bodies)]}}}
    refused = {"description": "Refused: the text says why, and what to do", **reply}
    paths: dict[str, Any] = {}
    for operation, shape in zip(OPERATIONS, bodies, strict=False):
        said: dict[str, Any] = {
            "summary": operation.summary, "operationId": f"{operation.method.lower()}_{operation.path.rpartition('/')[2]}",
            "responses": {"200": {"description": "Done", **reply}, "409": refused, "400": refused},
        }  # fmt: skip
        if operation.method in QUERIED:
            said["parameters"] = _parameters(components[shape.__name__])
        else:
            reference = {"$ref": f"#/components/schemas/{shape.__name__}"}
            said["requestBody"] = {"content": {"application/json": {"schema": reference}}, "required": True}
        paths.setdefault(operation.path, {})[operation.method.lower()] = said
    ok = {"content": {"application/json": {"schema": {"type": "object"}}}, "description": "Done"}
    paths[SETTABLE] = {
        "get": {
            "summary": "What can be set, and why the rest cannot",
            "operationId": "settable",
            "responses": {"200": ok},
        }
    }
    paths[OPENAPI] = {"get": {"summary": "This document", "operationId": "openapi", "responses": {"200": ok}}}
    paths[METRICS] = {
        "get": {
            "summary": "Where the metrics are", "operationId": "metrics",
            "responses": {"307": {"description": "At this place, in Prometheus' format"}, "404": refused},
        },
    }  # fmt: skip
    stream = {"text/event-stream": {"schema": {"type": "string"}}}
    paths[EVENT_STREAM] = {
        "get": {
            "summary": f"Events as they come, as server-sent events: {', '.join(EVENTS)}", "operationId": "events",
            "parameters": _parameters(components["EventFilter"]),
            "responses": {"200": {"description": "Each with `event`, and a ServerEvent as `data`", "content": stream}},
        },
    }  # fmt: skip
    info = {
        "title": "cogrip administration",
        "version": "1",
        "license": {"name": "Apache-2.0", "identifier": "Apache-2.0"},
    }
    return {"openapi": "3.1.0", "info": info, "paths": paths, "components": {"schemas": components}}


def _parameters(schema: Mapping[str, Any]) -> Sequence[dict[str, Any]]:
    return [
        {"name": name, "in": "query", "required": name in schema.get("required", ()), "schema": shape}
        for name, shape in schema["properties"].items()
    ]


def _text(value: str | float | bool | list[float]) -> str:
    """Return a JSON value as `cogrip set` has it."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, list):
        return ",".join([f"{each!r}" for each in value])
    return value if isinstance(value, str) else f"{value!r}"
