"""The seat: one tick of a hand, from the sample of its device to the force on it."""
