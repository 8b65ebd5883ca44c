"""Let a simulated person follow a motion of one's own: a figure of eight in virtual time."""

from math import cos, pi, sin

import msgspec

import cogrip.api as cogrip


class EightSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys: hand=eight&radius_m=0.02."""

    radius_m: float = 0.01
    period_s: float = 2.0


class Eight:
    """A `cogrip.Hand`: an intended motion behind a stiffness and a damping."""

    stiffness_npm, damping_nspm = 300.0, 5.0

    def __init__(self, settings: EightSettings, axes: int) -> None:
        self.settings, self.axes = settings, axes

    def open(self, rate_hz: int, home_m: tuple[float, ...] | None) -> tuple[float, ...]:
        self.rate_hz, self.home_m = rate_hz, home_m or (0.0,) * self.axes
        return self.home_m

    def intended(self, tick: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        w, r = 2.0 * pi / self.settings.period_s, self.settings.radius_m
        angle = w * tick / self.rate_hz
        away = (r * sin(angle), 0.5 * r * sin(2.0 * angle), 0.0)[: self.axes]
        speed = (r * w * cos(angle), r * w * cos(2.0 * angle), 0.0)[: self.axes]
        return tuple(h + x for h, x in zip(self.home_m, away, strict=True)), speed

    def drive(self, tick: int) -> list[float]:
        place, speed = self.intended(tick)
        return [self.stiffness_npm * x + self.damping_nspm * v for x, v in zip(place, speed, strict=True)]


cogrip.register_hand("eight", Eight, EightSettings)
users = {0: {"hand": "eight&radius_m=0.02"}, 1: {"hand": "hold"}}
run = cogrip.run("demo", seconds=2.5, object={"axes": 2}, users=users)
place = run.columns("server", "object_m")["object_m"]
print(f"the object went {1e3 * (place.max(axis=0) - place.min(axis=0))} mm along x and y; good: {run.good}")
