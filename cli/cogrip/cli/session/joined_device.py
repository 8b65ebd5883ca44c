"""Device that `cogrip join` holds: made, checked before the server is asked, and judged with the seat that it gets."""

from collections.abc import Callable
from importlib.util import find_spec

from cogrip.analysis.advice.advice import advise_seat, unbounded
from cogrip.analysis.advice.plausible import hand_findings
from cogrip.cli.settings.before_run import ALLOW, HELD_BY_NOBODY, refuse_implausible
from cogrip.cli.terminal.problem import BadInput
from cogrip.client.safety import rendered_damper
from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.device import Capability, Device, DeviceError
from cogrip.devices.for_user import HANDLESS, address_of, make_for
from cogrip.devices.registry import axes_of, make, record_of
from cogrip.devices.replayed.replayed_device import ReplayedDevice
from cogrip.machine.addition import add_floats
from cogrip.protocol.settings.delays import line_delay
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.room import seat_axes
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings

DEFAULT_DEVICE = "sim:phantom?hand=reach"
# The server chooses the settings, and the model's work grows with the cube of the frames in flight: a join must not hang.
MOST_ADVISED_TICKS = 256  # most ticks of a frame with which the model is computed
USUAL_HZ, LOOKED_AHEAD_S = 1024, 60.0  # rate and length with which a hand is checked before a server has told its own


def with_playback(address: str | None, **options: float | None) -> str | None:
    """Return a replay's address with the options in it. Raises BadInput for another device."""
    keys = "&".join(f"{key}={value:g}" for key, value in options.items() if value is not None)
    if not keys:
        return address
    if address is None or not address.startswith("replay:"):
        raise BadInput(f"{keys.partition('=')[0]}: is for a replay; name one, such as --device 'replay:RUN#user=0'")
    return f"{address}{'&' if '#' in address or '?' in address else '#'}{keys}"


def with_hand(devices: tuple[str, ...], hand: str, settings: Settings | None, name: str) -> tuple[str, ...]:
    """Return the devices with this hand in the address: of the device, else of the user's in the settings, else a Phantom's.

    Raises BadInput for a device that nothing simulated holds, or that has a hand already, and for two devices.
    """
    if not hand:
        return devices
    if len(devices) > 1:
        raise BadInput(f"--hand {hand!r}: is for one device; give each of two its own key hand=")
    users = [user.device for user in settings.users if name in ("", user.name)] if settings else []
    (address,) = devices or users[:1] or (DEFAULT_DEVICE.partition("?")[0],)
    if not address.startswith(HANDLESS):
        raise BadInput(
            f"--hand {hand!r}: is for a simulated device, and {address} is none; leave it out, or take sim:phantom"
        )
    if "hand=" in address:
        raise BadInput(f"--hand {hand!r}: {address} has a hand already; give one of them")
    return (f"{address}{'&' if '?' in address else '?'}hand={hand}",)


def make_joined(settings: Settings | None, name: str, address: str | None, axes: int | None) -> tuple[Device, str]:
    """Return the device and its address: `address`, else that of the user called `name` in the settings. Raises BadInput."""
    with BadInput.of(DeviceError):
        if settings is None:
            address = address or DEFAULT_DEVICE
            return _ready(make(address, axes=axes or axes_of(address)), address), address
        users = [user for user in settings.users if name in ("", user.name)]
        if not users:
            known = ", ".join(user.name for user in settings.users)
            raise BadInput(f"--name {name!r}: no such user in the settings; there is: {known}")
        axes = axes or seat_axes(settings, users[0])
        if address:
            return _ready(make(address, axes=axes), address), address
        return _ready(make_for(users[0], axes), address_of(users[0])), address_of(users[0])


def _ready(device: Device, address: str) -> Device:
    """Return `device` once its record is known, and that it may give force. Raises DeviceError."""
    record_of(device, address)
    if isinstance(device, ArmDevice) and device.reads_only:
        raise DeviceError(
            "pose=none opens an arm to read only, so nobody would feel anything: calibrate it, and leave the key out"
        )
    return device


def check_hand(
    make_again: Callable[[], tuple[Device, str]], address: str, name: str, seconds: float | None
) -> list[str]:
    """Raise BadInput for an implausible or unplayable simulated or recorded hand; warn of an unlikely one, and return that.

    make_again: makes the device to be tried, and its address.
    """
    if not address.startswith(HELD_BY_NOBODY):
        return []
    device, address = make_again()
    try:
        rate_hz = min(device.capability.rate_hz, USUAL_HZ)
        found = hand_findings(name or "this hand", address, device, rate_hz, seconds or LOOKED_AHEAD_S)
    except DeviceError as error:
        if isinstance(device, ReplayedDevice):  # at any rate: its span is empty, or the recording is damaged
            raise BadInput(str(error)) from None
        return []  # the seat's rate may be the one that fits; the session reports the error
    return refuse_implausible(found)


NO_MUJOCO = (
    "each client steps a copy of this room's scene, for which it needs the package mujoco-core, which is not installed; pip "
    "install mujoco-core, on a system that it has a wheel for (docs/platforms.md)"
)


def judge_seat(
    address: str, allow_unstable: bool, say: Callable[[str], None], seat: SeatSettings, record: Capability
) -> str:
    """Warn where this seat is not stable, passive or fit for its device, in the words of `cogrip advise`.

    Returns the reason to refuse it, "" if there is none.
    """
    frames = add_floats(line_delay(seat.playout, direction, seat.rates).frames for direction in (seat.up, seat.down))
    refused: tuple[str, ...] = ()
    warnings: tuple[str, ...]
    if seat.coupling.traits.gated and kind_of(seat.object.kind).scene and find_spec("mujoco") is None:
        return f"refused: {NO_MUJOCO}"
    if seat.coupling.traits.gated or not kind_of(seat.object.kind).plain:  # no model; what its device carries is known
        bounds = () if seat.coupling.traits.gated else unbounded(seat)
        warnings = tuple(filter(None, [rendered_damper.refusal(seat, record), *bounds]))
        refused = () if allow_unstable else warnings
    elif frames > seat.coupling.traits.advised_frames or seat.rates.ticks_per_frame > MOST_ADVISED_TICKS:
        warnings = ("no advice: the delays are too long for the model",)
    else:
        try:
            advice = advise_seat(seat, record)
            warnings, refused = advice.warnings, () if allow_unstable else advice.refusals
        except (ArithmeticError, ValueError) as error:  # ModelError and LinAlgError are ValueErrors
            warnings = (f"no advice: {error}",)
    for text in warnings:
        if text not in refused:
            say(f"warning: {text}")
    return refusal("; ".join(refused), address) if refused else ""


def refusal(reason: str, address: str) -> str:
    """Return the reason with what the person at the device can do about the server's settings."""
    return f"refused: {reason}; the settings are the server's{ALLOW if address.startswith(HELD_BY_NOBODY) else ''}"


def played_out(device: Device) -> str:
    """Return that a replay has come to its end, "" while it plays, and for other devices."""
    return "the replay has run out" if isinstance(device, ReplayedDevice) and device.played_out else ""
