"""The family `forcedimension:` and its query keys."""

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from cogrip.devices.device import Device, DeviceError, at_most
from cogrip.devices.forcedimension.forcedimension_device import ForceDimensionDevice
from cogrip.devices.forcedimension.models import RECORDS, axes_of, record_of
from cogrip.devices.forcedimension.sdk import Sdk
from cogrip.devices.registry import Family
from cogrip.devices.settings import Address, Setting, check_axes, read_query
from cogrip.protocol.axes import GRIP_AXES, POSE_AXES

MOST_DEVICES = 16


class ForceDimensionSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Query keys.

    model         what the device must be; without it any known one will do, within the limits of the weakest
    sdk           folder of the vendor's SDK, as the environment variable FDSDK names it
    peak_force_n  largest force [N], where less than the model's is wanted
    """

    model: Literal[
        "", "falcon", "omega3", "omega6", "omega7", "delta3", "delta6", "sigma3", "sigma6", "sigma7", "lambda3", "lambda7",
    ] = ""  # fmt: skip
    sdk: str = ""
    peak_force_n: Annotated[float, Meta(gt=0.0, le=40.0)] | None = None


def family() -> Family:
    """The family `forcedimension:`, for the registry."""
    what = (
        "Omega, delta, sigma, lambda, Falcon (Force Dimension SDK): forcedimension:0?model=omega3 by the SDK's number"
    )
    return Family(what, make, tuple(f"forcedimension:0?model={model}" for model in RECORDS), axes, real=True)


def axes(address: Address) -> int:
    """Return the number of axes of the model that is stated."""
    return axes_of(address.query.get("model", ""))


def make(address: Address, axes: int, defaults: Mapping[str, Setting]) -> Device:
    """A driver; the SDK is not loaded yet.

    Raises DeviceError for unknown keys, values out of bounds, a name that is no number, or a number of
    axes that the model has not.
    """
    where = repr(address.text)
    if axes != POSE_AXES:
        check_axes(axes, where, GRIP_AXES)
    if not (address.name.isascii() and address.name.isdigit() and int(address.name) < MOST_DEVICES):
        last = MOST_DEVICES - 1
        raise DeviceError(
            f"{where}: {address.name!r} is no number from 0 to {last}: write forcedimension:0 for the first device"
        )
    settings = read_query(ForceDimensionSettings, {**defaults, **address.query}, where)
    record = at_most(record_of(settings.model, axes, where), settings.peak_force_n)

    def load() -> Sdk:
        from cogrip.devices.io.dhd_library import load

        return load(settings.sdk)

    return ForceDimensionDevice(f"forcedimension:{address.name}", int(address.name), record, settings.model, load)
