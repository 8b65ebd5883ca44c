"""Inputs of a client's core other than ticks and datagrams: tagged values, as a recording holds them.

`ClientCore.handle` takes any of them, `ObserverCore.handle` those of its session (`SessionInput`).
"""

import re

import msgspec

from cogrip.devices.device import Capability, DeviceError
from cogrip.machine.tick_count import TickCount
from cogrip.protocol.settings.hand import HandChange


def _kind(name: str) -> str:
    """Return the tag of a class: KeepSeat -> keep_seat."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


class TaggedInput(msgspec.Struct, frozen=True, gc=False, tag_field="kind", tag=_kind):
    """Base of all inputs."""


class Connect(TaggedInput, frozen=True, gc=False):
    """Ask the server for a seat, or for an observer's place."""


class Poll(TaggedInput, frozen=True, gc=False):
    """Run the session's timers. Where no ticks are run, at least every 100 ms."""


class Patience(TaggedInput, frozen=True, gc=False):
    """Give a resumption up after so long a silence [ns], where the server does not ask for more."""

    give_up_ns: int


class Reached(TaggedInput, frozen=True, gc=False):
    """The server has made a handshake while it is silent: it is there, if not its room yet."""


class KeepSeat(TaggedInput, frozen=True, gc=False):
    """Send a sign of life before the first tick."""


class DeviceOpened(TaggedInput, frozen=True, gc=False):
    """The device is open, and its record differs from the one before."""

    capability: Capability


class DeviceFailed(TaggedInput, frozen=True, gc=False):
    """The device failed: latch a fault."""

    reason: str


class ForceApplied(TaggedInput, frozen=True, gc=False):
    """The device applies this force [N], shape (axes,), and not the one that `act` returned."""

    force_n: tuple[float, ...]


class Stop(TaggedInput, frozen=True, gc=False):
    """Release the hand and the object; `ClientCore.may_leave` says when that is done."""


class Rearm(TaggedInput, frozen=True, gc=False):
    """Leave a latched fault. The caller has removed its cause."""


class Clutch(TaggedInput, frozen=True, gc=False):
    """Hold the clutch, or release it, whatever its button does."""

    held: bool


class SetHand(TaggedInput, frozen=True, gc=False):
    """Change the hand's settings."""

    change: HandChange


class Mark(TaggedInput, frozen=True, gc=False):
    """Set a marker, for everybody in the room."""

    text: str


class CloseLedger(TaggedInput, frozen=True, gc=False):
    """Make up the account of this end. ticks: of its loop, as its driver counted them."""

    ticks: TickCount


class Leave(TaggedInput, frozen=True, gc=False):
    """Say goodbye with the account, or answer the farewell of a server that stopped first."""

    reason: str


SessionInput = Connect | Poll | Reached | Leave
ClientInput = (
    SessionInput
    | Patience
    | KeepSeat
    | DeviceOpened
    | DeviceFailed
    | ForceApplied
    | Stop
    | Rearm
    | Clutch
    | SetHand
    | Mark
    | CloseLedger
)

_decoder: msgspec.json.Decoder[ClientInput] = msgspec.json.Decoder(ClientInput)


def decode(text: str) -> ClientInput:
    """Return the input of a JSON text. Raises ValueError for any other text."""
    try:
        return _decoder.decode(text)
    except DeviceError as error:  # a record without limits
        raise ValueError(str(error)) from None
