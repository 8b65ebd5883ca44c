"""The table of measures: name with its unit at the end, what it is of, and the function (docs/measures.md)."""

from collections.abc import Callable
from typing import NamedTuple

from cogrip.results.measures import interaction, motion
from cogrip.results.measures.columns import RunColumns


class Measure(NamedTuple):
    """A measure of one person in a run.

    label     of an axis of a figure
    shared    the same number for everybody in a run
    opposite  two people add up to 0
    of_goal   of the trial's goal, so that a phase of the trial has none
    """

    name: str
    label: str
    of: Callable[[RunColumns, int], float | None]
    shared: bool = False
    opposite: bool = False
    of_goal: bool = False


MEASURES: tuple[Measure, ...] = (
    Measure("completion_s", "completion time [s]", motion.completion_s, shared=True, of_goal=True),
    Measure(motion.ENDPOINT, "end point beyond the target's middle [m]", motion.endpoint_m, shared=True, of_goal=True),
    Measure("path_m", "path length [m]", motion.path_m),
    Measure("deviation_m", "deviation from the straight way, peak [m]", motion.deviation_m, of_goal=True),
    Measure("lateral_force_n", "force across the straight way, peak [N]", motion.lateral_force_n, of_goal=True),
    Measure("tracking_rms_m", "tracking error, rms [m]", motion.tracking_rms_m, shared=True),
    Measure("jerk_rms_mps3", "jerk, rms [m/s³]", motion.jerk_rms_mps3),
    Measure("smoothness", "log dimensionless jerk", motion.smoothness),
    Measure("mean_force_n", "mean force on the hand [N]", motion.mean_force_n),
    Measure("interaction_mean_n", "interaction force, mean [N]", interaction.interaction_mean_n, shared=True),
    Measure("interaction_peak_n", "interaction force, peak [N]", interaction.interaction_peak_n, shared=True),
    Measure("synchrony", "synchrony", interaction.synchrony),
    Measure("lead_s", "lead over others [s]", interaction.lead_s, opposite=True),
    Measure("felt_stiffness_npm", "felt stiffness [N/m]", motion.felt_stiffness_npm),
)
BY_NAME = {measure.name: measure for measure in MEASURES}


def measure(run: RunColumns, person: int) -> dict[str, float | None]:
    """Return all measures of one person in a run, by name; None for what there is not."""
    return {each.name: each.of(run, person) for each in MEASURES}
