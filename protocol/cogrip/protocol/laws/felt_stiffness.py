"""Felt stiffness at rest: the line is a spring in series with the object (theory section 4).

    1/K_hand = 1/K + C_line        C_line = (T_fwd + T_back + T_lag) / (2b)

T_lag is `decimation.lag_s`; P's server step (a force one frame old) takes two frames off it. The same sum, read the
other way round, says which K' to render so that the hand feels K (`compensated_stiffness`).
"""

from math import ceil

MOST_GAIN = 100.0  # largest ratio of the rendered to the felt stiffness: beyond it the hand would feel at most 1 % more


class OutOfReachError(ValueError):
    """The wanted stiffness cannot be felt through this line, whatever the server renders."""


def line_compliance(impedance_nspm: float, round_trip_s: float, lag_s: float) -> float:
    """Return C_line [m/N] of a line with the given delays (round_trip_s = T_fwd + T_back)."""
    return (round_trip_s + lag_s) / (2.0 * impedance_nspm)


def felt_stiffness(stiffness_npm: float, compliance_mpn: float) -> float:
    """Return K_hand [N/m]."""
    return 1.0 / (1.0 / stiffness_npm + compliance_mpn) if stiffness_npm > 0.0 else 0.0


def compensated_stiffness(stiffness_npm: float, impedance_nspm: float, compliance_mpn: float) -> float:
    """Return K' [N/m] with 1/K' = 1/K - C_line. Raises OutOfReachError, with the impedance needed, if K C_line >= 1."""
    used = stiffness_npm * compliance_mpn  # K C_line
    if used < 1.0:
        return stiffness_npm / (1.0 - used)
    enough = enough_impedance(stiffness_npm, impedance_nspm, compliance_mpn)
    advised = ceil(1.1 * enough)
    raise OutOfReachError(
        f"coupling.compensate: a felt stiffness of {stiffness_npm:g} N/m is out of reach: at impedance "
        f"{impedance_nspm:g} N s/m the line alone is as soft as {1.0 / compliance_mpn:.4g} N/m. "
        f"An impedance above {enough:.4g} N s/m would do: set coupling.impedance_nspm = {advised} or more, "
        f"or ask for less than {1.0 / compliance_mpn:.4g} N/m, or shorten the delay"
    )


def reachable_stiffness(stiffness_npm: float, compliance_mpn: float) -> float:
    """Return K' as above, or MOST_GAIN K where that is less, as it is near K C_line = 1 and wherever K is out of reach."""
    return stiffness_npm / max(1.0 - stiffness_npm * compliance_mpn, 1.0 / MOST_GAIN)


def enough_impedance(stiffness_npm: float, impedance_nspm: float, compliance_mpn: float) -> float:
    """Return the impedance [N s/m] at which K C_line is 1: from there on K can be felt."""
    return stiffness_npm * compliance_mpn * impedance_nspm
