"""Length of a whole number in bits. Compiled, `bit_length.pyx` takes its place."""


def bit_length(number: int) -> int:
    """Return how many bits a number from 0 to 2**63 - 1 has; 0 has none."""
    return number.bit_length()
