"""`web:pointer`: a simulated mass that a pointer in a browser pulls; `web:idle` is one that nobody pulls."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol

import msgspec

from cogrip.devices.device import Device, DeviceError, Sample
from cogrip.devices.registry import Family
from cogrip.devices.settings import MOST_AXES, Address, Setting, keys_of, read_settings, unknown
from cogrip.devices.simulated.device import SimulatedDevice
from cogrip.devices.simulated.phantom import PhantomPlant, PhantomSettings, capability
from cogrip.devices.web.hand import PointerHand, PointerSettings
from cogrip.devices.web.messages import FrameError, OwnHand, decode_pointer, encode_own_hand, vector

TOLD_HZ = 64  # at which the page is told of its device
NAMES = ("idle", "pointer")


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
        self.counts: Counter[str] = Counter()
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
                    self.counts["malformed pointer message"] += 1
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


def family() -> Family:
    """Return the family `web:`, for the registry."""
    what = "a pointer in a browser: `cogrip join LINK --device web`"
    return Family(what, make, ("web:pointer",), stand_ins=("web:idle",), real=True)


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """Return a device. Raises DeviceError for an unknown name or key, or a value out of bounds."""
    where = repr(address.text)
    if address.name not in NAMES:
        raise unknown("web device", address.name, NAMES, where)
    if not 1 <= axes <= MOST_AXES:
        raise DeviceError(f"{where}: axes={axes} is out of 1 to {MOST_AXES}")
    query: dict[str, Setting] = {**defaults, **address.query}
    query.pop("hand", None)  # a simulated hand of the settings: here it is the pointer's
    ours, hands = keys_of(WebSettings), keys_of(PointerSettings)
    for key in query:
        if key not in ours and key not in hands:
            raise unknown("key", key, (*ours, *hands), where)
    settings = read_settings(WebSettings, {key: query[key] for key in query if key in ours}, where)
    pointer = read_settings(PointerSettings, {key: query[key] for key in query if key in hands}, where)
    link: PointerLink | None = None
    if address.name == "pointer" and settings.fd >= 0:
        from cogrip.devices.io.pointer_socket import PointerSocket  # a socket, only where there is one

        link = PointerSocket(settings.fd, where)
    return WebDevice(settings, pointer, axes, link)
