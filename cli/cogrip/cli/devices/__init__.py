"""Commands for devices: list, find, wizard, calibrate, check, conform, emulate."""
