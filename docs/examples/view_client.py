"""Follow a live session by the view's socket: print the object and the people; with --hand, lead a hand in a circle.

python docs/examples/view_client.py 'http://127.0.0.1:PORT/#TOKEN' [--hand]    the address that `cogrip view` prints

Written from docs/view.md alone. --hand needs `cogrip join LINK --device web`.
"""

import json
import math
import struct
import sys
import time
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

STATES = ("free", "joining", "live", "degraded", "fault", "silent")
HEAD, PERSON, POINTER = struct.Struct("<BBBBId3d3d4d"), struct.Struct("<BBBBI3d3d3d3d8fIf4f"), struct.Struct("<BBHI3d")
RADIUS_M, TURN_S, POINTER_PERIOD_S = 0.03, 4.0, 0.02


def millimetres(position, anchor=(0.0, 0.0, 0.0)):
    return " ".join(f"{1e3 * (value + held):+.3f}" for value, held in zip(position, anchor, strict=True))


def show(frame, people):
    """Print one frame; a hand is where its person holds the object."""
    _, _, count, _, _, time_s, *numbers = HEAD.unpack_from(frame)
    parts = [f"{time_s:.3f} s  object {millimetres(numbers[:3])}"]
    for each in range(count):
        seat, state, _, _, _, *numbers = PERSON.unpack_from(frame, HEAD.size + each * PERSON.size)
        if state != 0 and seat in people:
            hand, force_n = millimetres(numbers[:3], people[seat]["anchor_m"]), math.hypot(*numbers[6:9])
            parts.append(f"{people[seat]['name']} {STATES[state]} {hand} force {force_n:.3f} N")
    print("  ".join(parts), flush=True)


def follow(address, hand):
    """Talk until the server closes the socket. Each message about the own hand, 64 a second, is answered with its target."""
    token, people, begun_s, sent = urlsplit(address).fragment.removesuffix("&hand"), {}, None, 0
    with connect(f"ws://{urlsplit(address).netloc}/socket", subprotocols=["cogrip.view.v1"]) as socket:
        socket.send(json.dumps({"type": "hello", "token": token, "hand": hand}))
        while True:
            message = socket.recv()
            if isinstance(message, str):
                told = json.loads(message)
                people = {each["seat"]: each for each in told["people"]} if told["type"] == "scene" else people
            elif message[0] == 1:
                show(message, people)
            elif message[0] == 3:
                if begun_s is None:  # the circle begins where the hand is
                    begun_s, (x, y, z) = time.monotonic(), struct.unpack_from("<3d", message, 8)
                angle, sent = 2 * math.pi * (time.monotonic() - begun_s) / TURN_S, sent + 1
                circle = (x + RADIUS_M * (math.cos(angle) - 1), y + RADIUS_M * math.sin(angle), z)
                socket.send(POINTER.pack(2, 1, 0, sent, *circle))


if __name__ == "__main__":
    try:
        follow(sys.argv[1], "--hand" in sys.argv)
    except ConnectionClosed as error:
        sys.exit(f"closed: {error.rcvd.code if error.rcvd else 'without a word'}")
