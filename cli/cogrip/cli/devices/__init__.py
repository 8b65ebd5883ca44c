"""Commands for devices: list, find, wizard, calibrate, check, commission, conform, emulate."""
