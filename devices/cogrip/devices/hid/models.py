"""Arms on HID by their names in addresses."""

from cogrip.devices.arm.models import MODELS

ARMS = {name.removesuffix("-hid"): model for name, model in MODELS.items() if model.record.family == "hid"}
NAMES = tuple(ARMS)
