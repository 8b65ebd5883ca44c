"""The firmwares that speak these reports, and how one of them is told from other devices on the bus.

Sources: haptikfabrikenapi (host and mbed firmware), woody-experimental (the firmware of 2016), Teensy RawHID.
"""

from dataclasses import dataclass

USAGE = (0xFFAB, 0x0200)  # usage page and usage of all of them
MBED_ID = (0x1234, 0x0006)
MBED_PRODUCT = "HID DEVICE"  # the mbed library's own: any mbed toy has the same numbers, and most have this too
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
