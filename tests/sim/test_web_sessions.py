"""Whole sessions with `web:` hands whose pointers do what no hand does. Virtual time."""

from collections.abc import Callable
from itertools import product
from math import hypot, sin
from random import Random
from typing import Any

import pytest

from cogrip.devices.web.hand import RELEASE_S, SILENCE_S
from cogrip.devices.web.web_device import WebDevice
from cogrip.protocol.settings.room import resolve
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.extent import every
from tests.kinds import OBJECTS
from tests.sim.session_measures import least_margin

HZ = 1024
EVERY = 7  # ticks from one pointer message to the next: 144 Hz
FAR = {"delay_ms": 100, "jitter_ms": 10, "loss": 0.1, "burst_frames": 3}
JUMP_M = 0.1  # to either side
Pointer = Callable[[int], float | None]  # tick -> where every axis is to go [m], None: no message

WEB: dict[str, Any] = {"name": "web", "device": "web:pointer"}
OTHER: dict[str, Any] = {"name": "other", "device": "web:pointer", "side": "right"}
STRONG: dict[str, Any] = {
    "name": "strong", "device": "sim:ideal", "hand": "sine&amplitude_m=0.04&frequency_hz=1", "side": "right",
}  # fmt: skip


def jumps_at_random(seed: int) -> Pointer:
    random = Random(seed)
    return lambda tick: random.choice((-JUMP_M, JUMP_M))


def there_and_back(period_s: float, until_s: float = 1e9, sign: int = 1) -> Pointer:
    """Jump to and fro; stop in the middle of a jump."""

    def at(tick: int) -> float | None:
        if tick >= until_s * HZ:
            return None
        return sign * (JUMP_M if (tick / HZ) % period_s < 0.5 * period_s else -JUMP_M)

    return at


def calm(until_s: float) -> Pointer:
    return lambda tick: 0.03 * sin(4.0 * tick / HZ) if tick < until_s * HZ else None


def nobody(tick: int) -> None:
    return None


class Session:
    """A session whose web hands are moved by pointers; what they do is held to the bounds at every tick."""

    def __init__(self, users: list[dict[str, Any]], pointers: list[Pointer], seconds: float, **tables: object) -> None:
        self.laboratory = Laboratory(resolve({"seconds": seconds, "users": users, **tables}))
        self._pointers = pointers
        self.hand_n: list[list[float]] = [[] for _ in users]  # force between hand and device, tick by tick
        self.laboratory.run(self._tick)
        self.summary = of_laboratory(self.laboratory)

    def _tick(self, laboratory: Laboratory) -> None:
        tick = laboratory.tick
        for number, (person, pointer) in enumerate(zip(laboratory.people, self._pointers, strict=True)):
            device = person.supervised.device
            if not isinstance(device, WebDevice):
                continue
            assert hypot(*device.force_n) <= device.capability.peak_force_n * (1.0 + 1e-9)
            assert hypot(*device.velocity_mps) < device.capability.speed_mps
            power_w = sum(force * speed for force, speed in zip(device.force_n, device.velocity_mps, strict=True))
            assert abs(power_w) <= device.capability.peak_force_n * device.capability.speed_mps
            self.hand_n[number].append(hypot(*device.pointer.force_n()))
            if tick % EVERY == 0 and (target := pointer(tick)) is not None:
                device.pointer.point(tick + 1, (target,) * 3, holds=True)

    def holds_its_bounds(self) -> None:
        """Passive at the line and at the device, and nobody in a fault."""
        assert self.summary["passive"]
        assert not any(self.summary[key] for key in ("unstable", "saturated", "left"))
        assert least_margin(self.summary) >= -1e-12
        for user in self.summary["users"]:
            assert user["energy"]["device_margin_j"] >= 0.0
            assert user["state"] != "fault", user["reason"]


STREAMS = {
    "at random": lambda: [jumps_at_random(1), jumps_at_random(2)],
    "apart and together": lambda: [there_and_back(1 / 72), there_and_back(1 / 72, sign=-1)],
    "apart, far": lambda: [there_and_back(2.0), there_and_back(2.0, sign=-1)],
    "stops in a jump": lambda: [there_and_back(0.5, 0.7), jumps_at_random(3)],
}


@pytest.mark.sample(1)
@pytest.mark.parametrize(("stream", "kind", "link", "axes"), every(13, product(STREAMS, OBJECTS, ({}, FAR), (1, 3))))
def test_two_pointers_that_jump_stay_within_their_bounds(
    stream: str, kind: str, link: dict[str, Any], axes: int
) -> None:
    table: dict[str, Any] = {"object": {"kind": kind, "axes": axes}, "link": link}
    Session([WEB, OTHER], STREAMS[stream](), 1.5, **table).holds_its_bounds()


@pytest.mark.long
@pytest.mark.parametrize(("period_s", "link"), every(6, product((0.125, 0.5, 2.0), ({}, FAR))))
def test_to_beat_on_a_wall_for_long_is_no_fault(period_s: float, link: dict[str, Any]) -> None:
    Session([WEB], [there_and_back(period_s)], 7.0, object={"kind": "wall"}, link=link).holds_its_bounds()


@pytest.mark.sample(1)
@pytest.mark.parametrize("link", [{}, FAR], ids=["near", "far"])
@pytest.mark.parametrize("stop", [calm(1.0), there_and_back(0.5, 1.0)], ids=["calm", "in a jump"])
def test_a_pointer_that_stops_feels_nothing_within_a_moment(stop: Pointer, link: dict[str, Any]) -> None:
    """While somebody strong goes on to move the object."""
    session = Session([WEB, STRONG], [stop, nobody], 1.7, link=link)
    session.holds_its_bounds()
    forces = session.hand_n[0]
    assert max(forces[:HZ]) > 0.3
    silent = round((1.0 + SILENCE_S + RELEASE_S) * HZ) + EVERY + 2
    assert silent < 1.3 * HZ
    assert max(forces[silent:]) == 0.0


def test_a_device_that_was_let_go_is_carried_along() -> None:
    """It stays coupled, and its hand that is not there holds nothing back."""
    session = Session([WEB, STRONG], [calm(0.5), nobody], 2.0)
    web, strong = (person.supervised.device for person in session.laboratory.people)
    assert isinstance(web, WebDevice)
    assert web.position_m[0] == pytest.approx(strong.position_m[0], abs=0.02)  # type: ignore[attr-defined]
