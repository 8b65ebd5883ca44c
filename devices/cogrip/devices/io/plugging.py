"""The identity of a device's power-up: counters that began with it are void after the next one."""

from pathlib import Path

from cogrip.devices.io.platform import asleep_s

SYSFS, USBFS = Path("/sys/bus/usb/devices"), Path("/dev/bus/usb")
BOOT = Path("/proc/sys/kernel/random/boot_id")
SUSPENDED = Path("/sys/power/suspend_stats/success")


def stamp_of(path: str, sysfs: Path = SYSFS, usbfs: Path = USBFS) -> str:
    """Names this plugging-in, by what the system made anew for it; "" where that is not known.

    path: a device node such as /dev/hidrawN or /dev/ttyACM0, or libusb's 1-2.3:1.0, whose /dev/bus/usb node changes its
    times whenever it is used. The device may also lose its counters while the computer is suspended, and its node stays.
    """
    node, use_time = (Path(path), True) if path.startswith("/") else (_usb_node(path, sysfs, usbfs), False)
    try:
        made = node.stat() if node is not None else None
        boot = BOOT.read_text().strip()
    except OSError:
        return ""
    if made is None:
        return ""
    try:
        suspended = SUSPENDED.read_text().strip()
    except OSError:
        suspended = ""
    if (slept_s := asleep_s()) is not None:  # hibernation is not counted above
        suspended = f"{suspended}.{round(slept_s)}"
    when = f":{made.st_ctime_ns}" if use_time else ""
    return f"{boot}:{suspended}:{made.st_ino}:{getattr(made, 'st_rdev', 0)}{when}"


def _usb_node(path: str, sysfs: Path, usbfs: Path) -> Path | None:
    """The node of a device by its place on the bus."""
    try:
        bus, device = (int((sysfs / path.partition(":")[0] / name).read_text()) for name in ("busnum", "devnum"))
    except (OSError, ValueError):
        return None
    return usbfs / f"{bus:03d}" / f"{device:03d}"
