"""A simulated mass that a deflection steers: the hand is that of `web:`, and its set-point's speed follows the deflection."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import hypot
from typing import Annotated, Protocol

import msgspec
from msgspec import Meta

from cogrip.devices.device import DeviceError, Sample
from cogrip.devices.web.hand import STRETCH_N, PointerSettings, lead_m
from cogrip.devices.web.web_device import WebDevice, WebSettings
from cogrip.machine.rows import Vector

INPUT_ONLY = "input-only"  # model of every device that has no motors for its hand
MOST_MPS = 0.18  # speed at which all of the hand's pull goes into its own damper
RUMBLE_HZ = 20  # rate at which a motor is told its strength
RUMBLE_STEP = 0.05  # least change of the strength that is told


class SteeredSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys. speed_mps: at full deflection; dead: share of full deflection that is none; rumble: most of a motor, 0 to 1.

    path, serial: of one of several
    """

    speed_mps: Annotated[float, Meta(gt=0.0, le=MOST_MPS)] = 0.15
    dead: Annotated[float, Meta(ge=0.0, le=0.9)] = 0.08
    rumble: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.5
    mass_kg: float = 0.1
    damping_nspm: float = 0.5
    path: str = ""
    serial: str = ""


class Decoder(Protocol):
    """Meaning of the bytes of a controller.

    deflection  toward the user, right, up, each -1 to 1
    buttons     bit k is 1 while button k + 1 is held down
    silence_s   after which a deflection is one no more; 0 where only changes are told
    refused     messages that were none
    lacks       what the controller has not: axis of ours -> what would move it
    """

    deflection: Vector
    buttons: int
    silence_s: float
    lacks: Mapping[int, str]

    @property
    def refused(self) -> int: ...
    def feed(self, data: bytes) -> None: ...
    def rest(self) -> None:
        """Take everything as released."""


class ControllerBytes(Protocol):
    """Bytes from a controller. Verbs raise DeviceError where it is not there, or gone."""

    def open(self) -> Decoder: ...
    def receive(self) -> list[bytes]: ...
    def rumble(self, strength: float) -> None:
        """Let its motors turn with 0 to 1 of what they can; nothing where it has none."""

    def close(self) -> None: ...


class SteeredDevice(WebDevice):
    """The device of `web:` without a page: a controller moves its pointer, and nobody does without a link.

    The force is drawn and rumbled, never felt.
    """

    def __init__(
        self,
        family: str,
        settings: SteeredSettings,
        pointer: PointerSettings,
        axes: int,
        buttons: int,
        link: ControllerBytes | None,
    ) -> None:
        super().__init__(WebSettings(mass_kg=settings.mass_kg, damping_nspm=settings.damping_nspm), pointer, axes, None)
        self.capability = replace(self.capability, family=family, model=INPUT_ONLY, buttons=buttons)
        self._where = f"{family}:"
        self._settings = settings
        self._controller = link
        self._decoder: Decoder | None = None
        self._target: tuple[float, ...] = ()

    @property
    def counts(self) -> Mapping[str, int]:
        refused = self._decoder.refused if self._decoder is not None else 0
        return {**self._counts, **({"malformed report": refused} if refused else {})}

    def open(self, rate_hz: int) -> None:
        """Raises DeviceError also where the controller is not there, may not be opened, or lacks an axis."""
        self._check_open(rate_hz, self.capability)
        if self._controller is not None:
            self._decoder = self._controller.open()
            for axis, what in self._decoder.lacks.items():
                if axis < self.capability.axes:
                    self._controller.close()
                    cure = "take another one" if axis < 2 else "take another one, or object.axes = 2"
                    raise DeviceError(f"{self._where} nothing of it would move {'xyz'[axis]}: it has no {what}; {cure}")
        super().open(rate_hz)
        self._target = self.position_m
        self._silent_ticks = round((self._decoder.silence_s if self._decoder else 0.0) * rate_hz)
        self._told_ticks = max(1, rate_hz // RUMBLE_HZ)
        self._reported, self._strength = 0, 0.0

    def read(self, tick: int) -> Sample:
        """See `Device.read`. Takes the controller's messages first. Raises DeviceError where it is gone."""
        link, decoder = self._controller, self._decoder
        if not self._open or link is None or decoder is None:
            return super().read(tick)
        for message in link.receive():
            decoder.feed(message)
            self._reported = tick
        if self._silent_ticks and any(decoder.deflection) and tick - self._reported > self._silent_ticks:
            decoder.rest()
            self._counts["silent while deflected: stopped"] += 1
        self._steer(tick, decoder.deflection)
        sample = super().read(tick)
        if tick % self._told_ticks == 0:
            self._shake(link)
        return Sample(sample.position_m, sample.velocity_mps, sample.age_ticks, decoder.buttons)

    def _steer(self, tick: int, deflection: Vector) -> None:
        """Point so far ahead of the set-point that it goes at the speed asked for; where none is, it stops on its way."""
        size, dead = hypot(*deflection), self._settings.dead
        if size > dead:
            speed = self._settings.speed_mps * min(1.0, (size - dead) / (1.0 - dead))
            ahead = lead_m(speed) / size
            at = self.pointer.set_point_m
            bounds = self.capability.workspace_m
            self._target = tuple(
                [min(high, max(low, p + ahead * d)) for p, d, (low, high) in zip(at, deflection, bounds, strict=False)]
            )
        self.pointer.point(tick, self._target, holds=True)

    def _shake(self, link: ControllerBytes) -> None:
        """Rumble as strongly as the mass is loaded, of what the hand can pull with."""
        strength = min(self._settings.rumble, self._settings.rumble * hypot(*self._force) / STRETCH_N)
        if abs(strength - self._strength) >= RUMBLE_STEP or (self._strength and not strength):
            self._strength = strength
            link.rumble(strength)

    def close(self) -> None:
        super().close()
        if self._controller is not None:
            self._controller.close()
