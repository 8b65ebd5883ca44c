"""`cogrip devices`: the commands for devices, and for making them ready."""

from cyclopts import App

from cogrip.cli.devices.listing import device_list
from cogrip.cli.terminal.commands import add_commands

COMMANDS = {
    "list": ("devices.listing:device_list", "List the devices that have an address, with their records."),
    "find": ("devices.find:device_find", "Find the devices that are plugged in here."),
    "wizard": ("devices.wizard:device_wizard", "Set up a device step by step."),
    "calibrate": ("devices.calibrate:device_calibrate", "Calibrate a device, and keep the calibration."),
    "check": ("devices.check:device_check", "Check whether a device is fit to be held: signs, rate, noise, latency."),
    "commission": (
        "devices.commission:device_commission",
        "Try a device from 5 % of its force upward, and leave a signed sheet.",
    ),
    "conform": ("devices.conform:device_conform", "Run the conformance suite on one device."),
    "emulate": ("devices.emulate:device_emulate", "Serve an emulated device on a pseudo-terminal or a socket."),
}

devices = App(name="devices")
add_commands(devices, COMMANDS)
devices.default(device_list)
