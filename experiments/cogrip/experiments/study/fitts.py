"""Pointing by Fitts's law, as ISO 9241-411 states it: effective width, index of difficulty, throughput.

    W_e = 4.133 s      A_e = mean distance moved      ID_e = log2(A_e / W_e + 1)      TP = ID_e / MT

s [m] is the standard deviation of end points along the way to the target (n - 1 in it), MT [s] the mean movement time, both of
the trials of one group and condition. A group's throughput is the mean over its conditions, not that of all trials together.

A spread of n trials is known within 1 / sqrt(2 (n - 1)) of itself, so the standard error of TP is by first order

    TP sqrt((g / ID_e)^2 (1 / (2 (n - 1)) + (s / A_e)^2 / n) + (s_MT / MT)^2 / n),   g = A_e / ((A_e + W_e) ln 2)
"""

from collections import defaultdict
from math import ceil, hypot, log, log2, nan, sqrt
from statistics import fmean, stdev
from typing import Any, NamedTuple

from cogrip.experiments.study.table import Row, StudyTable
from cogrip.protocol.recording.schema import unit_of
from cogrip.results.measures.motion import ENDPOINT
from cogrip.results.reading.columns import NUMBER, Column

WIDTHS = 4.133
"""Standard deviations in an effective width: the square root of 2 pi e. 96 % of a normal distribution lie in so many."""
FEWEST = 3  # least number of trials of which a spread is told
ENOUGH = 0.1  # half of an interval of 95 % that is narrow enough, as a share of the throughput
_Z = 1.96


class Pointing(NamedTuple):
    """Trials of one group in one condition, and its throughput.

    trials, missed      how many reached the target, how many did not and are left out
    distance_m, width_m of the target; difficulty_bits by them, log2(A / W + 1)
    effective_...       by the end points; nan of fewer than FEWEST trials, or of none that differ
    throughput_error_bitps  standard error
    """

    group: int
    condition: str
    trials: int
    missed: int
    distance_m: float
    width_m: float
    difficulty_bits: float
    movement_s: float
    effective_distance_m: float
    effective_width_m: float
    effective_difficulty_bits: float
    throughput_bitps: float
    throughput_error_bitps: float


class Throughput(NamedTuple):
    """Throughput of a group, half of its interval of 95 %, and the trials a condition that narrow this to ENOUGH."""

    bitps: float
    within_bitps: float
    trials: int


COLUMNS = [
    Column(name, NUMBER if kind is float else "string" if kind is str else "int64", unit_of(name))
    for name, kind in Pointing.__annotations__.items()
]


def pointing(table: StudyTable) -> list[Pointing]:
    """Return one for each group and condition that has a target, practice left out; in the order of the table."""
    trials: defaultdict[tuple[int, str], list[Row]] = defaultdict(list)
    for row in table.rows:
        if not row["practice"] and row["seat"] == 0:  # what is measured is of the object, so of all who hold it
            trials[row["group"], row["condition"]].append(row)
    found = []
    for (group, condition), rows in trials.items():
        goal = table.study.goal_of(table.study.changes(condition))
        if goal.within_m is not None and (distance_m := hypot(*goal.place_m)) > 0.0:
            found.append(_pointing(group, condition, rows, distance_m, 2.0 * goal.within_m))
    return found


def _pointing(group: int, condition: str, rows: list[Row], distance_m: float, width_m: float) -> Pointing:
    reached = [row for row in rows if row.get(ENDPOINT) is not None and row.get("completion_s") is not None]
    ends = [row[ENDPOINT] for row in reached]
    spread_m = stdev(ends) if len(ends) >= FEWEST else 0.0
    movement_s = fmean(row["completion_s"] for row in reached) if reached else nan
    moved_m = width_e = bits = error = nan
    if spread_m > 0.0:
        moved_m, width_e = distance_m + fmean(ends), WIDTHS * spread_m
        bits = log2(moved_m / width_e + 1.0)
        count = len(ends)
        slope = moved_m / ((moved_m + width_e) * log(2.0) * bits)
        of_time = stdev(row["completion_s"] for row in reached) / movement_s
        of_ends = 0.5 / (count - 1) + (spread_m / moved_m) ** 2 / count
        error = bits / movement_s * sqrt(slope * slope * of_ends + of_time * of_time / count)
    return Pointing(
        group, condition, len(reached), len(rows) - len(reached), distance_m, width_m, log2(distance_m / width_m + 1.0),
        movement_s, moved_m, width_e, bits, bits / movement_s if movement_s > 0.0 else nan, error,
    )  # fmt: skip


def throughputs(found: list[Pointing]) -> dict[int, Throughput]:
    """Return the throughput of each group: the mean over those of its conditions that have one."""
    of_group: defaultdict[int, list[Pointing]] = defaultdict(list)
    for each in found:
        if each.throughput_bitps == each.throughput_bitps:
            of_group[each.group].append(each)
    return {group: _throughput(conditions) for group, conditions in of_group.items()}


def _throughput(conditions: list[Pointing]) -> Throughput:
    bitps = fmean(each.throughput_bitps for each in conditions)
    within = _Z * hypot(*[each.throughput_error_bitps for each in conditions]) / len(conditions)
    trials = fmean(each.trials for each in conditions)
    return Throughput(bitps, within, max(FEWEST, ceil(trials * (within / (ENOUGH * bitps)) ** 2)))


def rows_of(found: list[Pointing]) -> list[list[Any]]:
    """Return the columns of a table, in the order of COLUMNS; what is not known is None."""
    return [[None if value != value else value for value in column] for column in zip(*found, strict=True)]
