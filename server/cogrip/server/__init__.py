"""The shared object: worlds, seats, rooms, the sans-IO core and the 128 Hz loop."""

import cogrip.machine  # noqa: F401 - chooses the form of all modules
