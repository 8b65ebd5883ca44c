"""`web:pointer`: a simulated mass that a pointer in a browser pulls; `web:idle` is one that nobody pulls."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import msgspec

from cogrip.devices.device import Sample
from cogrip.devices.simulated.device import SimulatedDevice
from cogrip.devices.simulated.phantom import PhantomPlant, PhantomSettings, capability
from cogrip.devices.web.hand import PointerHand, PointerSettings
from cogrip.devices.web.messages import FrameError, OwnHand, decode_pointer, encode_own_hand, vector

TOLD_HZ = 64  # at which the page is told of its device


class WebSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys. fd: file descriptor of the link to the page."""

    fd: int = -1
    mass_kg: float = 0.1
    damping_nspm: float = 0.5


class PointerLink(Protocol):
    """Datagrams to and from a page."""

    def receive(self) -> list[bytes]: ...
    def send(self, message: bytes) -> None: ...


class WebDevice(SimulatedDevice):
    """A simulated device whose hand is the pointer of a page."""

    def __init__(self, settings: WebSettings, pointer: PointerSettings, axes: int, link: PointerLink | None) -> None:
        machine = PhantomSettings(
            mass_kg=settings.mass_kg, damping_nspm=settings.damping_nspm, friction_n=0.0, resolution_m=0.0
        )
        plant = PhantomPlant(machine, axes)
        self.pointer = PointerHand(pointer, plant)
        record = replace(capability(machine, axes), family="web", model="idle" if link is None else "pointer")
        super().__init__(record, plant, self.pointer)
        self._link = link
        self._taken = 0
        self._every = 1

    def open(self, rate_hz: int) -> None:
        """See `Device.open`."""
        super().open(rate_hz)
        self._every = max(1, rate_hz // TOLD_HZ)

    def read(self, tick: int) -> Sample:
        """See `Device.read`. Takes the pointer's messages first."""
        if self._link is not None:
            for message in self._link.receive():
                try:
                    pointed = decode_pointer(message)
                except FrameError:
                    self._counts["malformed pointer message"] += 1
                    continue
                self._taken = pointed.number
                self.pointer.point(tick, pointed.target_m, holds=pointed.holds)
        sample = super().read(tick)
        if self._link is not None and tick % self._every == 0:
            state = "live" if self.pointer.holds else "free"
            force = vector([-force for force in self.force_n])
            at, limit = vector(self.position_m), self.capability.peak_force_n
            self._link.send(encode_own_hand(OwnHand(state, self._taken, at, force, limit)))  # type: ignore[arg-type]
        return sample
