"""Input reports of a SpaceMouse, by hidapi; or of a stand-in behind a local socket, as `HidLine` has it."""

import os
from typing import Any

from cogrip.devices.device import DeviceError
from cogrip.devices.hid.enumeration import Found
from cogrip.devices.io.hid_line import found_devices, load_hidapi
from cogrip.devices.io.report_socket import SocketDevice, is_socket
from cogrip.devices.steered.spacemouse import USB_IDS, SpaceMouseDecoder

LONGEST = 64
MOST_AT_ONCE = 32
MULTI_AXIS = (0x01, 0x08)  # usage page and usage of a multi-axis controller


class HidReports:
    """See `Link` of `steered.device`. path and serial choose among several."""

    def __init__(self, name: str, path: str, serial: str) -> None:
        self.name = name
        self._asked = path, serial
        self._device: Any = None

    def open(self) -> SpaceMouseDecoder:
        """Raises DeviceError where there is none, or more than one, or where it may not be opened."""
        path, serial = self._asked
        if is_socket(path):
            try:
                self._device = SocketDevice(path)
            except OSError as error:
                raise DeviceError(f"{self.name}: {path} cannot be opened ({error.strerror})") from None
            return SpaceMouseDecoder()
        hidapi = load_hidapi("auto", self.name)
        found = self._choose([each for usb_id in USB_IDS for each in found_devices(hidapi, usb_id)], path, serial)
        device = hidapi.device()
        try:
            device.open_path(os.fsencode(found.path))
            device.set_nonblocking(1)
        except OSError as error:
            raise DeviceError(
                f"{self.name}: {found.path} cannot be opened ({error}); close the program that uses it (spacenavd), or give"
                " yourself the right to it (udev rules: configs/99-cogrip.rules)"
            ) from None
        self._device = device
        return SpaceMouseDecoder()

    def _choose(self, found: list[Found], path: str, serial: str) -> Found:
        whole = {each.path: each for each in found if each.usage in ((0, 0), MULTI_AXIS)}
        fit = [each for each in whole.values() if path in ("", each.path) and serial in ("", each.serial)]
        if len(fit) == 1:
            return fit[0]
        there = "; ".join(map(str, whole.values())) or "none"
        if fit:
            raise DeviceError(f"{self.name}: {len(fit)} are there: {there}; choose by path= or serial=")
        raise DeviceError(
            f"{self.name}: no SpaceMouse of this path and serial number is there, of {there}; plug one in, and on Linux let"
            " yourself use it (udev rules: configs/99-cogrip.rules)"
        )

    def receive(self) -> list[bytes]:
        """Return the reports that wait. Raises DeviceError where it is unplugged."""
        reports: list[bytes] = []
        try:
            while len(reports) < MOST_AT_ONCE and (report := self._device.read(LONGEST)):
                reports.append(bytes(report))
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self.name}: unplugged ({error}); plug it in again, then re-arm") from None
        return reports

    def rumble(self, strength: float) -> None:
        """Do nothing: it has no motors."""

    def close(self) -> None:
        device, self._device = self._device, None
        if device is not None:
            device.close()
