"""Scenes and frames that the tests of the page show."""

from dataclasses import replace
from math import cos, pi, sin

import msgspec

from cogrip.machine.rows import Vector
from cogrip.view.frames import CONTACT, HAND_KNOWN, PUSHES, PersonFrame, SceneFrame, encode_chunk
from cogrip.view.scene import DrawnObject, Geometry, Mode, PageScene, SceneEvent, ScenePerson, colour

NAMES = ("anna", "ben", "chen", "dora", "emil")
FRAMES_HZ = 60
CHUNK_S = 10


def scene(people: int = 2, axes: int = 3, mode: Mode = "live", hand: bool = False) -> PageScene:
    """Return a scene with a box of 40 mm, whose middle no marker covers."""
    return PageScene(
        room="demo",
        mode=mode,
        axes=axes,
        network_hz=128,
        device_hz=1024,
        object=DrawnObject("mass", "box", (0.04, 0.04, 0.04), 0.5),
        people=tuple([ScenePerson(seat, NAMES[seat], colour(seat), anchor(seat, people)) for seat in range(people)]),
        geometry=(Geometry("plane", (-0.1, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.2, 0.2)),),
        hand=hand,
        own_seat=0 if hand else None,
    )


def anchor(seat: int, people: int) -> Vector:
    """Return where on the object a person holds it: around its middle, 28 mm away."""
    angle = pi + 2 * pi * seat / people
    return 0.028 * cos(angle), 0.028 * sin(angle), 0.0


def frame(number: int, position_m: Vector = (0.0, 0.0, 0.0), people: int = 2, contact: bool = False) -> SceneFrame:
    """Return a frame with people who hold the object at `position_m`, each a little apart from it."""
    x, y, z = position_m
    return SceneFrame(
        axes=3,
        number=number,
        time_s=number / FRAMES_HZ,
        position_m=position_m,
        velocity_mps=(0.1, 0.0, 0.0),
        flags=CONTACT if contact else 0,
        people=tuple([person(seat, number, (x, y, z)) for seat in range(people)]),
    )


def person(seat: int, number: int, object_m: Vector) -> PersonFrame:
    x, y, z = object_m
    wave = sin(0.05 * number + seat)
    return PersonFrame(
        seat=seat,
        state="live",
        flags=HAND_KNOWN | (PUSHES if seat == 0 else 0),
        lost=number // 100,
        hand_m=(x - 0.01 * (1 + wave), y + 0.004 * seat, z + 0.012),
        proxy_m=(x, y, z),
        force_n=(1.2 * wave, 0.4, -0.3 * seat),
        seen_m=(x - 0.004 * (seat + 1), y, z + 0.002),
        rtt_ms=40.0 + 8 * seat + 3 * wave,
        up_ms=24.0 + wave,
        down_ms=22.0 + seat,
        buffer_up_ms=8.0 + wave,
        buffer_down_ms=7.5 - wave,
        up_reserve_mj=1.5 + 0.2 * wave,
        line_reserve_mj=0.4 + 0.1 * wave,
        loss=0.01 * seat,
    )


def moving(number: int, people: int = 2) -> SceneFrame:
    """Return a frame of an object on its way around a circle that no float32 holds."""
    angle = number / 37
    position: Vector = (0.05 * cos(angle), 0.05 * sin(angle), 0.01 * sin(angle / 3))
    return frame(number, position, people, contact=number % 120 < 60)


def recording(seconds: int, people: int = 2) -> tuple[PageScene, list[bytes], list[SceneFrame]]:
    """Return scene, chunks and frames of a recording."""
    frames = [moving(number, people) for number in range(seconds * FRAMES_HZ)]
    size = CHUNK_S * FRAMES_HZ
    parts = [frames[first : first + size] for first in range(0, len(frames), size)]
    events = (
        SceneEvent(2.0, "joined", "ben", "ben joined"),
        SceneEvent(7.5, "marker", "", "marker: grip"),
        SceneEvent(14.0, "lost", "ben", "ben was lost"),
    )
    told = scene(people, mode="recording")
    whole = msgspec.structs.replace(told, duration_s=seconds, chunks=len(parts), events=events)
    return whole, [encode_chunk(number, part) for number, part in enumerate(parts)], frames


def lost(before: SceneFrame, seat: int) -> SceneFrame:
    """Return a frame in which a person has no state."""
    people = tuple([PersonFrame(each.seat) if each.seat == seat else each for each in before.people])
    return replace(before, people=people)
