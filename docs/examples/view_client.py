"""Follow a session by the view's socket: print the object and the people; with --hand, lead a hand in a circle.

python docs/examples/view_client.py 'http://127.0.0.1:PORT/#TOKEN' [--hand]    the address that `cogrip view` prints

Written from docs/view.md alone. Of a recording, every frame is printed. --hand needs `cogrip join LINK --device web`.
"""

import gzip
import json
import math
import struct
import sys
import time
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

STATES = ("free", "joining", "live", "degraded", "fault", "silent")
HEAD, PERSON, POINTER = struct.Struct("<BBBBId3d3d4d"), struct.Struct("<BBBBI3d3d3d3d8f"), struct.Struct("<BBHI3d")
RADIUS_M, TURN_S, POINTER_PERIOD_S = 0.03, 4.0, 0.02


def millimetres(position, anchor=(0.0, 0.0, 0.0)):
    return " ".join(f"{1e3 * (value + held):+.3f}" for value, held in zip(position, anchor, strict=True))


def show(frame, scene):
    """Print one frame; a hand is where its person holds the object."""
    _, _, count, _, _, time_s, *numbers = HEAD.unpack_from(frame)
    parts = [f"{time_s:.3f} s  object {millimetres(numbers[:3])}"]
    told = {person["seat"]: person for person in scene["people"]}
    for each in range(count):
        seat, state, _, _, _, *numbers = PERSON.unpack_from(frame, HEAD.size + each * PERSON.size)
        if state != 0 and seat in told:
            name, anchor = told[seat]["name"], told[seat]["anchor_m"]
            force_n = math.hypot(*numbers[6:9])
            parts.append(f"{name} {STATES[state]} {millimetres(numbers[:3], anchor)} force {force_n:.3f} N")
    print("  ".join(parts), flush=True)


def follow(address, hand):
    """Talk until the server closes the socket."""
    token = urlsplit(address).fragment.removesuffix("&hand")
    with connect(f"ws://{urlsplit(address).netloc}/socket", subprotocols=["cogrip.view.v1"], max_size=None) as socket:
        socket.send(json.dumps({"type": "hello", "token": token, "hand": hand}))
        scene, begun_s, sent = {}, None, 0
        while True:
            try:
                message = socket.recv(timeout=POINTER_PERIOD_S)
            except TimeoutError:
                message = b""
            wanted = None  # number of the chunk to ask for
            if isinstance(message, str):
                told = json.loads(message)
                if told["type"] == "scene":
                    scene, wanted = told, 0 if told["chunks"] else None
            elif message[:1] == b"\x01":
                show(message, scene)
            elif message[:1] == b"\x03" and begun_s is None:  # own hand: the circle begins where it is
                begun_s, (x, y, z) = time.monotonic(), struct.unpack_from("<3d", message, 8)
            elif message[:1] == b"\x04":
                frames, count = gzip.decompress(message[12:]), struct.unpack_from("<I", message, 8)[0]
                for each in range(count):
                    show(frames[each * len(frames) // count :][: len(frames) // count], scene)
                wanted = struct.unpack_from("<I", message, 4)[0] + 1
            if wanted is not None and wanted == scene["chunks"]:
                return
            if wanted is not None:
                socket.send(json.dumps({"type": "chunk", "number": wanted}))
            if begun_s is not None and time.monotonic() >= begun_s + sent * POINTER_PERIOD_S:
                angle = 2 * math.pi * (time.monotonic() - begun_s) / TURN_S
                at_m = (x + RADIUS_M * (math.cos(angle) - 1), y + RADIUS_M * math.sin(angle), z)
                sent += 1
                socket.send(POINTER.pack(2, 1, 0, sent, *at_m))


if __name__ == "__main__":
    try:
        follow(sys.argv[1], "--hand" in sys.argv)
    except ConnectionClosed as error:
        sys.exit(f"closed: {error.rcvd.code if error.rcvd else 'without a word'}")
    except KeyboardInterrupt:
        pass
