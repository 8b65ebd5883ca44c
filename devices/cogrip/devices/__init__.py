"""Force-feedback devices and their stand-ins, made by address: `registry.make("sim:phantom?hand=reach", axes=3)`."""

from cogrip.devices.device import Capability, Device, DeviceError, Sample
from cogrip.devices.registry import describe, families, make

__all__ = ["Capability", "Device", "DeviceError", "Sample", "describe", "families", "make"]
