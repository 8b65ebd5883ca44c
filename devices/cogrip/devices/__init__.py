"""Force-feedback devices and their stand-ins, made by address: `registry.make("sim:phantom?hand=reach", axes=3)`."""

import cogrip.machine  # noqa: F401 - chooses the form of all modules
from cogrip.devices.device import Capability, Device, DeviceError, Sample
from cogrip.devices.registry import describe, families, make

__all__ = ["Capability", "Device", "DeviceError", "Sample", "describe", "families", "make"]
