"""Random texts, frames and requests at a page server that runs: nothing crashes it, and every refusal is counted."""

import asyncio
import logging
import random
import struct
from collections import Counter

import pytest

from cogrip.devices.web.messages import Pointer, encode_pointer

from tests.view.event_loop import run
from tests.view.shown_page import BINARY, HELLO, TEXT, RawClient, ShownFeed, frame_bytes, shown_page, upgrade

TOGETHER = 16  # clients at once
EXPECTED = {
    "malformed request", "Host is not this page's (socket)", "Origin is not this page's (socket)", "unknown path",
    "Host is not this page's", "Origin is not this page's", "token",
    "malformed message", "message too large", "second hello", "no such chunk",
    "pointer without a hand", "reply without a study", "text that is not UTF-8", "malformed websocket frame",
}  # fmt: skip
FILLER = b"\0" * 20_000
TEXTS = (
    HELLO, HELLO.replace("t0ken", "token"), '{"type":"hello","token":"t0ken","hand":true}', '{"type":"chunk","number":0}',
    '{"type":"reply","number":1,"text":"5"}', '{"type":"reply","number":-1,"text":""}',
    '{"type":"chunk","number":-1}', '{"type":"chunk","number":1e999}', '{"type":"hello","token":null}', "null", "[]", '"', "",
)  # fmt: skip


def mutated(chance: random.Random, data: bytes) -> bytes:
    """Return bytes with a few changed, left out, put in or repeated."""
    changed = bytearray(data)
    for _ in range(chance.choice((0, 1, 1, 2, 5))):
        at = chance.randrange(len(changed) + 1)
        match chance.randrange(4):
            case 0:
                changed[at : at + 1] = bytes([chance.randrange(256)])
            case 1:
                del changed[at : at + chance.choice((1, 4, 40))]
            case 2:
                changed[at:at] = chance.randbytes(chance.choice((1, 3, 200)))
            case 3:
                changed[at:at] = changed[at : at + 16] * chance.choice((1, 2, 300))
    return bytes(changed)


def message(chance: random.Random) -> bytes:
    """Return one frame of a websocket, or what pretends to be one."""
    match chance.randrange(6):
        case 0:
            return frame_bytes(mutated(chance, chance.choice(TEXTS).encode()), TEXT)
        case 1:
            target = [chance.choice((0.0, 0.05, 1e308, -1e-320, float("nan"), float("inf"))) for _ in range(3)]
            pointer = encode_pointer(
                Pointer(chance.randrange(2**32), chance.random() < 0.5, (target[0], target[1], target[2]))
            )
            return frame_bytes(mutated(chance, pointer), BINARY)
        case 2:
            return frame_bytes(
                chance.randbytes(chance.choice((0, 1, 36, 96, 125, 126, 4096, 4097, 9000))), chance.randrange(16)
            )
        case 3:
            return mutated(chance, frame_bytes(HELLO.encode(), TEXT))
        case 4:
            return struct.pack("!BBQ", 0x81, 0xFF, chance.randrange(2**64)) + chance.randbytes(20)
        case _:
            first = chance.randrange(256) & 0xF0
            return frame_bytes(
                chance.randbytes(chance.randrange(130)), chance.randrange(16), first, masked=chance.random() < 0.9
            )


async def attack(port: int, chance: random.Random, met: Counter[str]) -> int:
    """Open one connection, send a few messages or a broken request, and return how many messages were sent."""
    if chance.random() < 0.2:
        client = await RawClient.connect(port)
        headers = ["Origin: https://evil.example"] if chance.random() < 0.3 else []
        client.write(mutated(chance, upgrade(port, *headers)))
        count = 1
    else:
        client = await RawClient.upgraded(port)
        if chance.random() < 0.5:
            client.send(HELLO.encode())
        count = chance.choice((1, 1, 2, 5))
        for _ in range(count):
            client.write(message(chance))
    if chance.random() < 0.1:
        client.abort()
        met["aborted"] += 1
        return count
    for _ in range(chance.choice((0, 0, 5))):
        await asyncio.sleep(0)  # the server judges some messages before all are there
    client.write(FILLER)  # whatever came before, nobody takes this for a frame or a request
    met[str(await client.closed())] += 1
    return count


async def fuzz(messages: int, seed: int) -> tuple[Counter[str], Counter[str], ShownFeed, int]:
    """Return codes that clients met, refusals by name, the feed at the end, and the difference of who came and left."""
    async with shown_page() as shown:
        met: Counter[str] = Counter()
        chances = [random.Random(seed + each) for each in range(TOGETHER)]

        async def one(chance: random.Random) -> None:
            sent = 0
            while sent < messages / TOGETHER:
                sent += await attack(shown.server.port, chance, met)
                shown.feed.show(sent)

        await asyncio.gather(*[one(chance) for chance in chances])
        await shown.until_nobody()
        client = await RawClient.upgraded(shown.server.port)  # it still serves
        client.send(HELLO.encode())
        assert (await client.read())[1].startswith(b'{"type":"scene"')
        client.abort()
        await shown.until_nobody()
        return met, Counter(shown.refused), shown.feed, shown.entered - shown.left


def check(messages: int, seed: int, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        met, refused, feed, within = run(fuzz(messages, seed))
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR], caplog.text
    assert set(refused) <= EXPECTED, refused
    total = sum(met.values())
    assert total - met["aborted"] <= sum(refused.values()) <= total, (met, refused)
    assert len(refused) >= 10, refused
    assert "1011" not in met, "an internal error"
    assert (feed.tabs, within) == ({}, 0)


def test_2000_fuzzed_messages_crash_nothing_and_are_counted(caplog):
    check(2_000, 1, caplog)


@pytest.mark.long
def test_100000_fuzzed_messages_crash_nothing_and_are_counted(caplog):
    check(100_000, 2, caplog)
