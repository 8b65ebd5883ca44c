"""The shared object: worlds, seats, rooms, the sans-IO core and the 128 Hz loop."""
