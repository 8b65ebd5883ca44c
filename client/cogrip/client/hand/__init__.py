"""The hand as a device gives it: its frame, axes, velocity and buttons."""
