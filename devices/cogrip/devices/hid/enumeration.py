"""The firmwares that speak these reports, and the choice of a device on the bus by its address. Pure.

Sources: haptikfabrikenapi (host and mbed firmware), woody-experimental (the firmware of 2016), Teensy RawHID.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from cogrip.devices.device import DeviceError

MOST_LISTED = 8
USAGE = (0xFFAB, 0x0200)  # usage page and usage of all variants
MBED_ID = (0x1234, 0x0006)
MBED_PRODUCT = "HID DEVICE"
"""Product name that the mbed library itself gives: any mbed toy has the same numbers, and most have this name too."""
TEENSY_ID = (0x16C0, 0x0486)


@dataclass(frozen=True, slots=True)
class Variant:
    """report_bytes: of a report either way, without its id; product: the string it must show, "" for any."""

    usb_id: tuple[int, int]
    report_bytes: int
    product: str
    gives_force: bool = True

    @property
    def usb_text(self) -> str:
        """Return the USB ids as `lsusb` writes them."""
        return f"{self.usb_id[0]:04x}:{self.usb_id[1]:04x}"


VARIANTS: dict[str, Variant] = {
    "mbed14": Variant(MBED_ID, 14, MBED_PRODUCT),
    "teensy64": Variant(TEENSY_ID, 64, ""),
    "mbed8": Variant(MBED_ID, 8, MBED_PRODUCT, gives_force=False),
}


@dataclass(frozen=True, slots=True)
class Found:
    """One HID interface as hidapi lists it. usage: page and usage, (0, 0) where the backend does not say (libusb)."""

    path: str
    usb_id: tuple[int, int]
    serial: str = ""
    product: str = ""
    usage: tuple[int, int] = (0, 0)
    interface: int = -1

    def __str__(self) -> str:
        return f"path={self.path} serial={self.serial or '(none)'}"


def choose(found: Iterable[Found], variant: Variant, name: str, path: str = "", serial: str = "") -> Found:
    """The one device of this variant, with this path and serial number where they are given.

    Raises DeviceError where there is none or more than one, with what there is and the key that helps.
    """
    same = list({each.path: each for each in found if each.usb_id == variant.usb_id and _speaks(each)}.values())
    ours = [each for each in same if not variant.product or each.product in ("", variant.product)]
    asked = [each for each in ours if (not path or each.path == path) and (not serial or each.serial == serial)]
    if len(asked) == 1:
        return asked[0]
    if asked:
        key = "path" if len({each.serial for each in asked}) < len(asked) else "serial"
        raise DeviceError(
            f"{name}: {len(asked)} devices {variant.usb_text} are there: {_list(asked)}; choose by {key}="
        )
    if ours:
        given = " ".join(f"{key}={value}" for key, value in (("path", path), ("serial", serial)) if value)
        raise DeviceError(f"{name}: none of the devices {variant.usb_text} has {given}; there are: {_list(ours)}")
    if same:
        raise DeviceError(
            f"{name}: {variant.usb_text} at {_list(same)} says it is {same[0].product!r}, not {variant.product!r}:"
            " other mbed boards have the same numbers; plug in the right one"
        )
    raise DeviceError(
        f"{name}: no device {variant.usb_text} is there; plug it in and power it, and on Linux let yourself use it"
        " (udev rules: configs/99-cogrip.rules)"
    )


def _speaks(each: Found) -> bool:
    """A Teensy has a second interface, for debug output; where usages are not told, the reports are on the first."""
    return each.usage == USAGE if each.usage != (0, 0) else each.interface <= 0


def _list(found: Sequence[Found]) -> str:
    remainder = len(found) - MOST_LISTED
    return "; ".join(map(str, found[:MOST_LISTED])) + (f"; and {remainder} more" if remainder > 0 else "")
