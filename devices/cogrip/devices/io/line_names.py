"""Names of lines as this system has them, for examples. "" where it has none such."""

import sys

SERIAL_LINE = {"win32": "COM3", "darwin": "/dev/tty.usbmodem101"}.get(sys.platform, "/dev/ttyACM0")
HID_DEVICE = "/dev/hidraw0" if sys.platform == "linux" else ""
EVENT_FILE = "/dev/input/event5" if sys.platform == "linux" else ""
