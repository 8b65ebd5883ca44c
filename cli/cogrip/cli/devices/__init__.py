"""Commands for devices: list, find, calibrate, check, conform, emulate."""
