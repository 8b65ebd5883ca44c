"""Energy and stretch of a spring whose force ends at a bound, and the part of a wish that a force is."""

from collections.abc import Sequence
from math import sqrt

from cogrip.machine.addition import add_floats


def spring_j(stiffness_npm: float, stretch_m: float, peak_n: float) -> float:
    """Return the energy in a spring whose force ends at `peak_n`."""
    force = stiffness_npm * abs(stretch_m)
    if force <= peak_n:
        return 0.5 * force * abs(stretch_m)
    return peak_n * (abs(stretch_m) - 0.5 * peak_n / stiffness_npm)


def stretch_m(stiffness_npm: float, energy_j: float, peak_n: float) -> float:
    """Return the stretch of a spring with this energy, whose force ends at `peak_n`: the inverse of `spring_j`."""
    force = sqrt(2.0 * stiffness_npm * energy_j)
    return force / stiffness_npm if force <= peak_n else energy_j / peak_n + 0.5 * peak_n / stiffness_npm


def part_of(force_n: Sequence[float], wish_n: Sequence[float]) -> float:
    """Return the part of a wish that a force is, along it."""
    square = add_floats([each * each for each in wish_n])
    return add_floats([a * b for a, b in zip(force_n, wish_n, strict=True)]) / square if square else 0.0
