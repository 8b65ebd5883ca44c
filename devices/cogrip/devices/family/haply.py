"""The family `haply:` and its query keys."""

from collections.abc import Mapping

from cogrip.devices.arm.exchange import ByteLine
from cogrip.devices.arm.motors import NO_CURRENT
from cogrip.devices.arm.pose import Store
from cogrip.devices.device import Device, DeviceError
from cogrip.devices.haply.frames import HaplyCodec, reset_frame
from cogrip.devices.haply.haply_device import HaplyDevice
from cogrip.devices.haply.line import LAST_RESORT_ID
from cogrip.devices.haply.models import MODELS, HaplyModel, HaplySettings, model_of
from cogrip.devices.io.guard import Goodbye
from cogrip.devices.io.line_names import SERIAL_LINE
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting, check_axes, read_query

MAX_AXES = 2


def family() -> Family:
    """The family `haply:`, for the registry."""
    what = f"Haply's planar arms (2DIY, Pantograph) on a serial line, two axes: haply:{SERIAL_LINE}?model=2diy"
    examples = tuple(f"haply:{SERIAL_LINE}?model={name}" for name in MODELS)
    stand_ins = tuple(f"emulated:{name}" for name in MODELS)
    return Family(what, make, examples, axes=lambda _: MAX_AXES, stand_ins=stand_ins, real=True)


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """A driver; the line is not opened yet. Raises DeviceError for unknown keys and values out of bounds."""
    from cogrip.devices.io.calibration_store import CalibrationStore
    from cogrip.devices.io.guarded_line import GuardedLine, any_number

    if not address.name:
        raise DeviceError(
            f"{address.text!r}: name the port, such as haply:{SERIAL_LINE}; `cogrip devices find` lists them"
        )
    name = f"haply:{address.name}"
    codec = HaplyCodec(_model(address, axes)[1].wiring, LAST_RESORT_ID)
    line = GuardedLine(address.name, "haply", lambda: goodbye(codec))
    return drive(line, name, CalibrationStore(), address, axes, codec, any_number())


def goodbye(codec: HaplyCodec) -> Goodbye:
    """Return the guard's last bytes to the board; a board that lost its setup gets a new one first."""
    last, wiring = HaplyCodec(codec.wiring, LAST_RESORT_ID), codec.wiring
    anew = (reset_frame(LAST_RESORT_ID), wiring.setup(LAST_RESORT_ID), last.encode(NO_CURRENT))
    return Goodbye(codec.encode(NO_CURRENT), bytes((codec.device_id,)), codec.reply_bytes, anew)


def drive(
    line: ByteLine,
    name: str,
    store: Store,
    address: Address,
    axes: int,
    codec: HaplyCodec | None = None,
    number: int = 0,
) -> HaplyDevice:
    """The driver on a line of whatever kind. codec: that of the line's goodbye, where it has one; number: see `HaplyDevice`."""
    settings, model = _model(address, axes)
    codec = codec or HaplyCodec(model.wiring, LAST_RESORT_ID)
    return HaplyDevice(name, axes, line, codec, model, settings.pose, store, number)


def _model(address: Address, axes: int) -> tuple[HaplySettings, HaplyModel]:
    where = repr(address.text)
    check_axes(axes, where, MAX_AXES, ": it is a planar arm")
    settings = read_query(HaplySettings, address.query, where)
    return settings, model_of(settings, where)
