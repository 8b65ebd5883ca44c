"""A wave line, one direction at a time: sender, receiver, jitter buffer, concealment, delays, energy sums (SPEC.md 5)."""
