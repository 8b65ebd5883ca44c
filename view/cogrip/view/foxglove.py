"""One client of the Foxglove WebSocket protocol, as Foxglove and Lichtblick are: messages in, messages out, no socket.

Specification: github.com/foxglove/ws-protocol, before its last commits; playback control: github.com/foxglove/foxglove-sdk.
Messages are JSON, in channels `/scene`, `/tf`, `/forces` (pictures), `/object` and `/<person>/state` (the frame's numbers).

    message data: 1 u8, subscription u32, log time u64 [ns], payload       time: 2 u8, time u64 [ns]
    playback state: 5 u8, status u8, time u64, speed f32, sought u8, u32 length of the request's id, id
    playback request (from the client): 3 u8, command u8, speed f32, seeks u8, time u64, u32 length of its id, id
"""

from collections.abc import Iterator, Sequence
from math import isfinite
from struct import Struct, error
from typing import Any, NamedTuple

import msgspec

from cogrip.protocol.recording.scene_messages import FRAME_TRANSFORMS, SCENE_UPDATE, SCHEMAS, json_schema
from cogrip.view import pictures
from cogrip.view.frames import SceneFrame
from cogrip.view.numbers import ObjectNumbers, PersonNumbers, object_numbers, person_numbers
from cogrip.view.playback import Playback, Status
from cogrip.view.scene import PageScene

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
MOST_BYTES = 64 * 1024  # most bytes of a message from the client
MOST_SUBSCRIPTIONS = 1024
SCENE_EVERY_S = 1.0
INFO, WARNING, ERROR = 0, 1, 2
_DATA, _TIME, _STATE = 1, 2, 5
_PLAYBACK_REQUEST = 3
_NOT_OFFERED_BINARY = (1, 2)  # operations that are not offered: client message data, service call
_NOT_OFFERED = (
    "advertise", "unadvertise", "getParameters", "setParameters", "subscribeParameterUpdates", "unsubscribeParameterUpdates",
    "subscribeConnectionGraph", "unsubscribeConnectionGraph", "fetchAsset",
)  # fmt: skip
_STATUS_CODES: dict[Status, int] = {"playing": 0, "paused": 1, "ended": 3}
_COMMANDS = (0, 1)  # commands of a playback request: play, pause
_DATA_HEAD = Struct("<BIQ")
_TIME_MESSAGE = Struct("<BQ")
_STATE_HEAD = Struct("<BBQfBI")
_REQUEST_HEAD = Struct("<BBfBQI")

Outgoing = str | bytes


class FoxgloveError(ValueError):
    """A message that is not of the protocol; the text says why."""


class OfferedTopic(NamedTuple):
    """A topic that is offered. seat: of a person's numbers."""

    number: int
    topic: str
    schema_name: str
    schema: bytes
    seat: int | None = None


class _Subscription(msgspec.Struct, frozen=True):
    id: int
    channel: int = msgspec.field(name="channelId")


class _Subscribe(msgspec.Struct, frozen=True):
    subscriptions: list[_Subscription]


class _Unsubscribe(msgspec.Struct, frozen=True):
    numbers: list[int] = msgspec.field(name="subscriptionIds")


class _Operation(msgspec.Struct, frozen=True):
    op: str


def subprotocol(offered: Sequence[str]) -> str | None:
    """Return the subprotocol to take of those that a client offers; None: refuse it."""
    return next((each for each in offered if each in SUBPROTOCOLS), None)


class FoxgloveSession:
    """State of one client: the channels it was offered and those it takes.

    began_ns  log time of the scene's time 0
    playback  of a recording: the client's own; it is the caller who lets it play at first
    """

    def __init__(self, scene: PageScene, began_ns: int = 0, playback: Playback | None = None) -> None:
        self._scene = scene
        self._began_ns = began_ns
        self._playback = playback
        self._numbers = 0
        self._channels: dict[int, OfferedTopic] = {}
        self._subscribed: dict[int, int] = {}  # subscription -> channel
        self._scene_at_s: float | None = None
        self._drawn: frozenset[str] = frozenset()
        self._told: Status | None = None
        self._offer()

    def _offer(self) -> list[OfferedTopic]:
        """Add the channels that are not offered yet, and return them."""
        wanted: list[tuple[str, str, bytes, int | None]] = [
            ("/scene", SCENE_UPDATE, SCHEMAS[SCENE_UPDATE], None),
            ("/tf", FRAME_TRANSFORMS, SCHEMAS[FRAME_TRANSFORMS], None),
            ("/forces", SCENE_UPDATE, SCHEMAS[SCENE_UPDATE], None),
            ("/object", "cogrip.ObjectNumbers", json_schema(ObjectNumbers), None),
        ]
        person_schema = json_schema(PersonNumbers)
        wanted += [
            (f"/{person.name}/state", "cogrip.PersonNumbers", person_schema, person.seat)
            for person in self._scene.people
        ]
        there = {(channel.topic, channel.seat) for channel in self._channels.values()}
        added: list[OfferedTopic] = []
        for topic, name, schema, seat in wanted:
            if (topic, seat) not in there:
                self._numbers += 1  # a number is never given twice
                added.append(OfferedTopic(self._numbers, topic, name, schema, seat))
        self._channels.update({channel.number: channel for channel in added})
        return added

    def opening(self, now_s: float = 0.0) -> list[Outgoing]:
        """Return what a new client is sent first."""
        info: dict[str, Any] = {
            "op": "serverInfo",
            "name": f"cogrip {self._scene.room}",
            "capabilities": ["time"],
            "metadata": {"room": self._scene.room, "mode": self._scene.mode},
            "sessionId": f"{self._scene.room} {self._began_ns}",
        }
        if self._playback is not None:
            info["capabilities"].append("playbackControl")
            info["dataStartTime"] = _sec_nsec(self._log_ns(0.0))
            info["dataEndTime"] = _sec_nsec(self._log_ns(self._scene.duration_s or 0.0))
        sent: list[Outgoing] = [_text(info), _advertised(list(self._channels.values()))]
        if self._scene.note:
            sent.append(_status(INFO, self._scene.note))
        return sent + ([self._state(now_s)] if self._playback is not None else [])

    def change(self, scene: PageScene) -> list[Outgoing]:
        """Take another scene: somebody joined, or left. Return what the client is told of it."""
        self._scene = scene
        self._scene_at_s = None
        people = {(f"/{person.name}/state", person.seat) for person in scene.people}
        gone = [
            channel.number
            for channel in self._channels.values()
            if channel.seat is not None and (channel.topic, channel.seat) not in people
        ]
        for number in gone:
            del self._channels[number]
        self._subscribed = {key: channel for key, channel in self._subscribed.items() if channel not in gone}
        sent: list[Outgoing] = [_text({"op": "unadvertise", "channelIds": gone})] if gone else []
        added = self._offer()
        return [*sent, _advertised(added)] if added else sent

    def receive(self, message: str | bytes, now_s: float = 0.0) -> list[Outgoing]:
        """Take a message of the client and return the answers. Raises FoxgloveError for one that is not of the protocol."""
        if len(message) > MOST_BYTES:
            raise FoxgloveError(f"a message of {len(message)} bytes; the most is {MOST_BYTES}")
        if isinstance(message, bytes):
            return self._receive_binary(message, now_s)
        try:
            operation = msgspec.json.decode(message, type=_Operation).op
            if operation == "subscribe":
                return list(self._subscribe(msgspec.json.decode(message, type=_Subscribe).subscriptions))
            if operation == "unsubscribe":
                return list(self._unsubscribe(msgspec.json.decode(message, type=_Unsubscribe).numbers))
        except (ValueError, RecursionError) as problem:
            raise FoxgloveError(f"no message of the Foxglove protocol: {problem}") from None
        if operation in _NOT_OFFERED:
            return [_status(WARNING, f"{operation} is not offered here")]
        raise FoxgloveError(f"{operation!r:.60} is no operation of the Foxglove protocol")

    def _subscribe(self, wanted: Sequence[_Subscription]) -> Iterator[Outgoing]:
        for each in wanted:
            if not 0 <= each.id < 2**32 or each.id in self._subscribed or len(self._subscribed) >= MOST_SUBSCRIPTIONS:
                yield _status(ERROR, f"subscription {each.id} is in use, or is no u32, or there are too many")
            elif each.channel not in self._channels:
                yield _status(WARNING, f"channel {each.channel} is not there")
            elif each.channel in self._subscribed.values():
                yield _status(WARNING, f"channel {each.channel} has a subscription already")
            else:
                self._subscribed[each.id] = each.channel
                self._scene_at_s = None
                if self._playback is not None:
                    self._playback.show_again()

    def _unsubscribe(self, numbers: Sequence[int]) -> Iterator[Outgoing]:
        for number in numbers:
            if self._subscribed.pop(number, None) is None:
                yield _status(WARNING, f"subscription {number} is not there")

    def _receive_binary(self, message: bytes, now_s: float) -> list[Outgoing]:
        if not message:
            raise FoxgloveError("an empty message")
        if message[0] in _NOT_OFFERED_BINARY:
            return [_status(WARNING, "publishing and services are not offered here")]
        if message[0] != _PLAYBACK_REQUEST:
            raise FoxgloveError(f"{message[0]} is no opcode of a client")
        try:
            _, command, speed, seeks, time_ns, length = _REQUEST_HEAD.unpack_from(message)
            request = message[_REQUEST_HEAD.size :].decode()
        except (error, UnicodeDecodeError) as problem:
            raise FoxgloveError(f"no playback request: {problem}") from None
        if (
            command not in _COMMANDS
            or length != len(message) - _REQUEST_HEAD.size
            or not (isfinite(speed) and speed > 0)
        ):
            raise FoxgloveError(f"no playback request: command {command}, speed {speed}, id of {length} bytes")
        playback = self._playback
        if playback is None:
            return [_status(WARNING, "this session is live: it cannot be played back")]
        playback.set_speed(speed, now_s)
        if seeks:
            playback.seek((time_ns - self._began_ns) * 1e-9, now_s)
        if command:
            playback.pause(now_s)
        elif playback.status(now_s) != "playing":
            playback.play(now_s)
        return [self._state(now_s, bool(seeks), request)]

    def due(self, now_s: float) -> list[Outgoing]:
        """Return what the playback has for the client by now."""
        if self._playback is None:
            return []
        sent: list[Outgoing] = [message for frame in self._playback.due(now_s) for message in self.messages(frame)]
        if self._playback.status(now_s) != self._told:
            sent.append(self._state(now_s))
        return sent

    def next_s(self, now_s: float) -> float | None:
        """Return when `due` wants to be called next; None: not before a message came."""
        if self._playback is None:
            return None
        next_s = self._playback.next_s(now_s)
        return now_s if next_s is None and self._playback.status(now_s) != self._told else next_s

    def _state(self, now_s: float, sought: bool = False, request: str = "") -> bytes:
        assert self._playback is not None
        self._told = self._playback.status(now_s)
        text = request.encode()
        time_ns = self._log_ns(self._playback.place_s(now_s))
        head = (_STATE, _STATUS_CODES[self._told], time_ns, self._playback.speed, sought, len(text))
        return _STATE_HEAD.pack(*head) + text

    def messages(self, frame: SceneFrame) -> list[bytes]:
        """Return the time and the messages of the channels that the client takes."""
        if not self._subscribed:
            return []
        time_ns = self._log_ns(frame.time_s)
        sent = [_TIME_MESSAGE.pack(_TIME, time_ns)]
        for number, channel in self._subscribed.items():
            payload = self._payload(self._channels[channel], frame, time_ns)
            if payload is not None:
                sent.append(_DATA_HEAD.pack(_DATA, number, time_ns) + payload)
        return sent

    def _payload(self, channel: OfferedTopic, frame: SceneFrame, time_ns: int) -> bytes | None:
        if channel.seat is not None:
            person = next((each for each in frame.people if each.seat == channel.seat), None)
            return person_numbers(person, frame.time_s) if person else None
        if channel.topic == "/object":
            return object_numbers(frame)
        if channel.topic == "/tf":
            return pictures.transforms(self._scene, frame, time_ns)
        if channel.topic == "/forces":
            return pictures.forces(self._scene, frame, time_ns)
        drawn = pictures.drawn(self._scene, frame)
        since_s = None if self._scene_at_s is None else frame.time_s - self._scene_at_s
        if drawn == self._drawn and since_s is not None and 0.0 <= since_s < SCENE_EVERY_S:
            return None
        self._drawn, self._scene_at_s = drawn, frame.time_s
        return pictures.scene(self._scene, drawn, time_ns)

    def _log_ns(self, time_s: float) -> int:
        return min(max(0, self._began_ns + round(time_s * 1e9)), 2**64 - 1)


def _advertised(channels: Sequence[OfferedTopic]) -> str:
    """Return the message that offers channels."""
    table = [
        {
            "id": channel.number, "topic": channel.topic, "encoding": "json", "schemaName": channel.schema_name,
            "schema": channel.schema.decode(), "schemaEncoding": "jsonschema",
        }
        for channel in channels
    ]  # fmt: skip
    return _text({"op": "advertise", "channels": table})


def _status(level: int, text: str) -> str:
    return _text({"op": "status", "level": level, "message": text})


def _sec_nsec(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // 10**9, "nsec": time_ns % 10**9}


def _text(message: dict[str, Any]) -> str:
    return msgspec.json.encode(message).decode()
