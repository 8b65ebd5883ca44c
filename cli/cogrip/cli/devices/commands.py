"""`cogrip devices`: what there is to hold, and making it ready."""

from cyclopts import App

from cogrip.cli.devices.listing import device_list

COMMANDS = {
    "list": (
        "cogrip.cli.devices.listing:device_list",
        "List the devices that can be named by address, with their records.",
    ),
    "find": ("cogrip.cli.devices.find:device_find", "Look for devices that are plugged in here."),
    "calibrate": ("cogrip.cli.devices.calibrate:device_calibrate", "Walk through a device's calibration, and keep it."),
    "check": (
        "cogrip.cli.devices.check:device_check",
        "Find out whether a device is fit to be held: signs, rate, noise, latency.",
    ),
    "conform": ("cogrip.cli.devices.conform:device_conform", "Try every promise that a device makes, on this one."),
    "emulate": (
        "cogrip.cli.devices.emulate:device_emulate",
        "Serve an emulated device on a pseudo-terminal or a socket.",
    ),
}

devices = App(name="devices", help="Force-feedback devices and their stand-ins.")
for _name, (_target, _help) in COMMANDS.items():
    devices.command(_target, name=_name, help=_help)
devices.default(device_list)
