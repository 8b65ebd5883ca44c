"""`web:pointer`: a simulated mass that a pointer in a browser pulls; `web:idle` is one that nobody pulls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import hypot
from typing import Protocol

import msgspec

from cogrip.devices.device import IDEAL_SPEED_MPS, Sample
from cogrip.devices.simulated.phantom import PhantomPlant, PhantomSettings, capability
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.devices.web.hand import SILENCE_S, STRETCH_N, PointerHand, PointerSettings
from cogrip.devices.web.messages import BUTTONS, FrameError, OwnHand, State, decode_pointer, encode_own_hand, vector

PEAK_N = 20.0
"""More than six times what the hand pulls with (STRETCH_N): no motors get warm, and a force that sits at its limit
would be a fault."""
TOLD_HZ = 64  # rate at which the page is told of its device


class WebSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys. fd: file descriptor of the link to the page."""

    fd: int = -1
    mass_kg: float = 0.1
    damping_nspm: float = 0.5


class PointerLink(Protocol):
    """Datagrams to and from a page."""

    @property
    def closed(self) -> bool:
        """True once the page's process is gone."""
        ...

    def receive(self) -> list[bytes]: ...
    def send(self, message: bytes) -> None: ...


class WebDevice(SimulatedDevice):
    """A simulated device whose hand is the pointer of a page."""

    def __init__(self, settings: WebSettings, pointer: PointerSettings, axes: int, link: PointerLink | None) -> None:
        machine = PhantomSettings(
            mass_kg=settings.mass_kg, damping_nspm=settings.damping_nspm, friction_n=0.0, resolution_m=0.0,
            peak_force_n=PEAK_N, speed_mps=IDEAL_SPEED_MPS,
        )  # fmt: skip
        plant = PhantomPlant(machine, axes)
        self.pointer = PointerHand(pointer, plant)
        record = replace(
            capability(machine, axes), family="web", model="pointer", continuous_force_n=PEAK_N, buttons=BUTTONS
        )
        super().__init__(record, plant, self.pointer)
        self._link = link
        self._taken = self._pressed = 0
        self._newest_tick = 0  # of pointer messages
        self._every = self._rate_hz = 1

    def open(self, rate_hz: int) -> None:
        """See `Device.open`."""
        super().open(rate_hz)
        self._every = max(1, rate_hz // TOLD_HZ)
        self._rate_hz, self._pressed, self._newest_tick = rate_hz, 0, 0

    def read(self, tick: int) -> Sample:
        """See `Device.read`. Takes the pointer's messages first."""
        link = self._link
        if link is None:
            return super().read(tick)
        for message in link.receive():
            self._take(tick, message)
        if link.closed and self.pointer.holds:
            self.pointer.let_go()
            self._counts["page gone: let go"] += 1
        if self._pressed and (link.closed or tick - self._newest_tick > SILENCE_S * self._rate_hz):
            self._pressed = 0  # a page that is gone holds nothing down
        sample = super().read(tick).replaced(buttons=self._pressed)
        if tick % self._every == 0:
            state: State = "live" if self.pointer.holds else "free"
            force, limit_n = (
                vector([-force for force in self.pointer.force_n()]),
                min(self.capability.peak_force_n, STRETCH_N),
            )
            link.send(encode_own_hand(OwnHand(state, self._taken, vector(self.position_m), force, limit_n)))
        return sample

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        """See `Device.write`: the machine gives at most its peak."""
        super().write(force_n)
        size = hypot(*force_n)
        if size <= PEAK_N:
            return None
        self._force = tuple([force * PEAK_N / size for force in force_n])
        return self._force

    def _take(self, tick: int, message: bytes) -> None:
        try:
            pointed = decode_pointer(message)
        except FrameError:
            self._counts["malformed pointer message"] += 1
            return
        if self.pointer.holds and pointed.number <= self._taken:  # another tab counts from 1, once this one has let go
            self._counts["late pointer message"] += 1
            return
        self._taken, self._pressed, self._newest_tick = pointed.number, pointed.buttons, tick
        self.pointer.point(tick, pointed.target_m, holds=pointed.holds)
