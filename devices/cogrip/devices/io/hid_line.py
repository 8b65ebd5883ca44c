"""A HID device, by the package hidapi: its module `hidraw` (Linux) or `hid` (libusb on Linux, the system's own elsewhere).

Where the path is that of a local socket, an emulated device is behind it (`report_socket`), and hidapi is left out.

The system call that writes a report comes back when the device has taken it: within a millisecond, but from a device that hangs
only after one second (libusb) or five (hidraw). So reports are written in a thread of their own, and the loop does not wait;
what went wrong there is raised at the next verb. Reading while another thread writes is what hidapi allows.
"""

import os
import time
from collections import Counter
from collections.abc import Callable, Mapping
from importlib import import_module
from queue import SimpleQueue
from threading import Thread
from types import ModuleType
from typing import Any

from cogrip.devices.device import DeviceError
from cogrip.devices.hid.enumeration import Found, Variant, choose
from cogrip.devices.io import platform
from cogrip.devices.io.plugging import stamp_of
from cogrip.devices.io.report_socket import SocketDevice, is_socket

LONGEST_REPORT = 65  # bytes to ask for: one more than any report has, so that a longer one is not taken for a right one
MOST_WAITING = 64  # most reports that a system keeps
FIRST_MS = 50  # wait after opening in which a report that was waiting in the device comes
CLOSE_S = 0.2  # longest wait for the last report to go
PAUSE_S = 5e-5  # time between two looks, where the wait is shorter than the millisecond hidapi can wait


class _ReportWriter:
    """Writes the newest of the reports that wait. It closes the device too: nobody else may while a write is under way."""

    def __init__(self, device: Any) -> None:
        self.failure = ""
        self.replaced = 0
        self._device = device
        self._given = self._done = 0
        self._frames: SimpleQueue[bytes | None] = SimpleQueue()
        self._thread = Thread(target=self._serve, name="hid reports", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        return self._given != self._done

    def send(self, frame: bytes) -> None:
        self._given += 1
        self._frames.put(frame)

    def finish(self, wait_s: float) -> bool:
        """Return True once the last report is sent and the device is closed."""
        self._frames.put(None)
        self._thread.join(wait_s)
        return not self._thread.is_alive()

    def _serve(self) -> None:
        ending = False
        while not ending:
            taken = [self._frames.get()]
            while not self._frames.empty():
                taken.append(self._frames.get())
            ending = taken[-1] is None
            reports = [frame for frame in taken if frame is not None]
            if reports:
                self._write(reports[-1])
                self.replaced += len(reports) - 1
                self._done += len(reports)
        self._device.close()

    def _write(self, frame: bytes) -> None:
        if self.failure:
            return
        try:
            sent = self._device.write(frame)
        except (OSError, ValueError) as error:
            self.failure = f"lost ({error})"
            return
        if sent != len(frame):
            self.failure = f"unplugged, or it hangs: a report of {len(frame)} bytes was written, the answer is {sent}"


class HidLine:
    """See `ByteLine`. backend: "hidraw", "libusb", or "auto"; path and serial choose among several devices of the variant."""

    def __init__(self, name: str, variant: Variant, backend: str = "auto", path: str = "", serial: str = "") -> None:
        self.name = name
        self.path = ""
        self._variant = variant
        self._backend = backend
        self._asked = path, serial
        self._counts: Counter[str] = Counter()
        self._replaced = 0
        self._device: Any = None
        self._writer: _ReportWriter | None = None

    @property
    def counts(self) -> Mapping[str, int]:
        """Reports by what became of them, where that is not the usual."""
        replaced = self._replaced + (self._writer.replaced if self._writer is not None else 0)
        return {**self._counts, **({"report replaced by a newer one": replaced} if replaced else {})}

    def open(self) -> None:
        """Raises DeviceError where hidapi is missing, or where the device is not there, not alone, not ours, or another one."""
        if self._writer is not None:
            raise DeviceError(f"{self.name}: is open already; close it first")
        path, serial = self._asked
        path = os.path.realpath(path) if path.startswith("/") else path  # udev's links
        device = self._emulated(path) if is_socket(path) else self._real(path, serial)
        self._device, self._writer = device, _ReportWriter(device)
        try:
            self._discard()
        except DeviceError:
            self.close()
            raise

    def _real(self, path: str, serial: str) -> Any:
        hidapi = load_hidapi(self._backend, self.name)
        found = choose(found_devices(hidapi, self._variant.usb_id), self._variant, self.name, path, serial)
        device = hidapi.device()
        try:
            device.open_path(os.fsencode(found.path))
            device.set_nonblocking(1)
        except OSError as error:
            raise DeviceError(
                f"{self.name}: {found.path} cannot be opened ({error}); close the program that uses it, or give yourself"
                " the right to it (udev rules: configs/99-cogrip.rules)"
            ) from None
        self.path = found.path
        return device

    def _emulated(self, path: str) -> SocketDevice:
        try:
            device = SocketDevice(path)
        except OSError as error:
            raise DeviceError(
                f"{self.name}: {path} cannot be opened ({error.strerror}); start `cogrip devices emulate hid --link {path}`"
            ) from None
        self.path = path
        return device

    def _discard(self) -> None:
        """The report that was already waiting in the device is old: from power-up, or from its last host. It is one at most."""
        length = len(self._try(lambda device: device.read(LONGEST_REPORT, FIRST_MS)))
        if not length:
            return
        self._counts["old report thrown away"] += 1
        if length != self._variant.report_bytes:
            raise DeviceError(
                f"{self.name}: its reports have {length} bytes, not {self._variant.report_bytes};"
                " set the key variant to what its firmware is"
            )
        self.read()

    def write(self, frame: bytes) -> None:
        """Hand it over to be written. Raises DeviceError where an earlier one could not be."""
        writer = self._open_writer()
        self._check(writer)
        if writer.busy:
            self._counts["report waits for the one before"] += 1
        writer.send(frame)

    def read(self, wait_s: float = 0.0) -> bytes:
        """The newest report that waits."""
        writer = self._open_writer()
        newest = self._try(lambda device: _first(device, wait_s))
        if not newest:
            self._check(writer)
            return b""
        for _ in range(MOST_WAITING):
            newer = self._try(lambda device: device.read(LONGEST_REPORT))
            if not newer:
                break
            self._counts["older report passed over"] += 1
            newest = newer
        return bytes(newest)

    def _try(self, verb: Callable[[Any], list[int]]) -> list[int]:
        try:
            return verb(self._device)
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self.name}: unplugged ({error}); plug it in again, then re-arm") from None

    def _open_writer(self) -> _ReportWriter:
        if self._writer is None:
            raise DeviceError(f"{self.name}: is closed; open it first")
        return self._writer

    def _check(self, writer: _ReportWriter) -> None:
        if writer.failure:
            raise DeviceError(f"{self.name}: {writer.failure}; plug it in again, then re-arm")

    def close(self) -> None:
        """The last report is given a while to go."""
        writer, self._writer, self._device = self._writer, None, None
        if writer is None:
            return
        if not writer.finish(CLOSE_S):
            self._counts["closed while a report was on its way"] += 1
        self._replaced += writer.replaced

    def stamp(self) -> str:
        return stamp_of(self.path)


def _first(device: Any, wait_s: float) -> list[int]:
    """A report, or [] after wait_s. To hidapi 0 ms mean not at all or for ever, as the device is set: here, not at all."""
    report: list[int] = device.read(LONGEST_REPORT)
    if report or wait_s <= 0.0:
        return report
    if wait_s >= 1e-3:
        report = device.read(LONGEST_REPORT, int(wait_s * 1e3))
        return report
    until_s = time.perf_counter() + wait_s
    while not report and time.perf_counter() < until_s:
        time.sleep(PAUSE_S)
        report = device.read(LONGEST_REPORT)
    return report


def load_hidapi(backend: str, name: str) -> ModuleType:
    """The module of the package hidapi for this backend. Raises DeviceError where there is none."""
    if backend == "hidraw" and not platform.LINUX:
        raise DeviceError(f"{name}: backend=hidraw is Linux's; leave the key out here")
    module = "hidraw" if platform.LINUX and backend != "libusb" else "hid"
    try:
        hidapi = import_module(module)
    except ImportError as error:
        raise DeviceError(
            f"{name}: needs module {module!r} of the package hidapi ({error}); pip install hidapi"
        ) from None
    if not hasattr(hidapi, "device"):
        raise DeviceError(
            f"{name}: module {module!r} is that of the package `hid`, not of `hidapi`, which has the same name;"
            " pip uninstall hid, then pip install --force-reinstall hidapi"
        )
    return hidapi


def found_devices(hidapi: ModuleType, usb_id: tuple[int, int]) -> list[Found]:
    return [
        Found(
            os.fsdecode(each["path"]),
            (each["vendor_id"], each["product_id"]),
            each["serial_number"] or "",
            each["product_string"] or "",
            (each["usage_page"], each["usage"]),
            each["interface_number"],
        )
        for each in hidapi.enumerate(*usb_id)
    ]
