"""A client of the Foxglove WebSocket protocol, written from its specification alone; it shares no code with the server's side.

Text messages are JSON objects with `op`. Binary ones, little-endian: 1 message data (u32 subscription, u64 time, payload), 2
time (u64), 5 playback state (u8 status, u64 time, f32 speed, u8 sought, u32 length, id). A playback request is 3 (u8 command,
f32 speed, u8 seeks, u64 time, u32 length, id).
"""

import asyncio
import json
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

PLAY, PAUSE = 0, 1
PLAYING, PAUSED, BUFFERING, ENDED = range(4)
LIMIT_S = 20.0  # a server that says nothing for so long hangs


@dataclass
class Playback:
    status: int
    time_ns: int
    speed: float
    sought: bool
    request: str


@dataclass
class Client:
    socket: ClientConnection
    info: dict[str, Any] = field(default_factory=dict)
    channels: dict[int, dict[str, Any]] = field(default_factory=dict)
    statuses: list[dict[str, Any]] = field(default_factory=list)
    topics: dict[int, str] = field(default_factory=dict)  # by subscription
    data: dict[str, list[tuple[int, Any]]] = field(default_factory=dict)  # by topic
    times_ns: list[int] = field(default_factory=list)
    states: list[Playback] = field(default_factory=list)

    async def take(self) -> None:
        """Take one message of the server."""
        message = await asyncio.wait_for(self.socket.recv(), LIMIT_S)
        if isinstance(message, str):
            self._take_text(json.loads(message))
        else:
            self._take_binary(message)

    def _take_text(self, message: dict[str, Any]) -> None:
        match message["op"]:
            case "serverInfo":
                assert isinstance(message["name"], str)
                assert isinstance(message["capabilities"], list)
                self.info = message
            case "advertise":
                for channel in message["channels"]:
                    assert channel["id"] not in self.channels
                    assert channel["encoding"] == "json"
                    json.loads(channel["schema"])
                    self.channels[channel["id"]] = channel
            case "unadvertise":
                for number in message["channelIds"]:
                    del self.channels[number]
            case "status":
                assert message["level"] in (0, 1, 2)
                self.statuses.append(message)
            case other:
                raise AssertionError(f"the server sent {other}")

    def _take_binary(self, message: bytes) -> None:
        match message[0]:
            case 1:
                subscription, time_ns = struct.unpack_from("<IQ", message, 1)
                self.data.setdefault(self.topics[subscription], []).append((time_ns, json.loads(message[13:])))
            case 2:
                assert len(message) == 9
                self.times_ns.append(struct.unpack_from("<Q", message, 1)[0])
            case 5:
                status, time_ns, speed, sought, length = struct.unpack_from("<BQfBI", message, 1)
                assert len(message) == 19 + length
                self.states.append(Playback(status, time_ns, speed, bool(sought), message[19:].decode()))
            case other:
                raise AssertionError(f"the server sent binary {other}")

    async def subscribe(self, *topics: str) -> None:
        numbers = {channel["topic"]: number for number, channel in self.channels.items()}
        wanted = []
        for topic in topics:
            subscription = 1000 + len(self.topics)
            self.topics[subscription] = topic
            wanted.append({"id": subscription, "channelId": numbers[topic]})
        await self.socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    async def unsubscribe(self, *topics: str) -> None:
        numbers = [number for number, topic in self.topics.items() if topic in topics]
        await self.socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": numbers}))

    async def control(self, command: int, request: str, speed: float = 1.0, seek_ns: int | None = None) -> Playback:
        """Ask for playback; return the answer."""
        text = request.encode()
        head = struct.pack("<BBfBQI", 3, command, speed, seek_ns is not None, seek_ns or 0, len(text))
        await self.socket.send(head + text)
        while not (self.states and self.states[-1].request == request):
            await self.take()
        return self.states[-1]


@asynccontextmanager
async def connected(address: str, subprotocol: str = "foxglove.websocket.v1") -> AsyncIterator[Client]:
    """A client that has taken serverInfo and the first channels."""
    async with connect(address, subprotocols=[Subprotocol(subprotocol)]) as socket:
        assert socket.subprotocol == subprotocol
        client = Client(socket)
        await client.take()
        assert client.info  # it comes first
        while not client.channels:
            await client.take()
        yield client
