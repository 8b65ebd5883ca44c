"""Measures of how one hand and the object move (docs/measures.md). Each takes a run's columns and a person's number."""

from math import ceil, log, pi, sqrt

import numpy as np

from cogrip.results.measures.columns import Array, RunColumns

MOTION_HZ = 20.0  # corner of the filter: voluntary motion lies below 10 Hz, encoder steps above
_WIDTHS = 4.0  # number of standard deviations at which the filter is cut off
ENDPOINT = "endpoint_m"  # name of the measure of a task's end point
REST_S = 0.1  # time at the end over which a hand that presses rests
REST_MPS = 0.002
LEAST_PRESS_N = 0.05


def completion_s(run: RunColumns, person: int) -> float | None:
    """Time until the goal was reached, from when everybody was there."""
    return run.reached_s


def endpoint_m(run: RunColumns, person: int) -> float | None:
    """Where the object was when the target was taken, after its dwell: from the target's middle, along the way from the start.

    Positive is beyond the middle. None without a target, or where it was not reached.
    """
    reached_s, place = run.reached_s, np.array(run.goal.place_m)
    length = float(np.linalg.norm(place))
    if reached_s is None or not run.goal.stated or length == 0.0:
        return None
    taken = int(np.searchsorted(run.time_s, reached_s + run.goal.dwell_s - 0.5 / run.rate_hz))
    moved = (run.object_m[min(taken, len(run.object_m) - 1)] - run.object_m[0])[: len(place)]
    return float((moved - place[: len(moved)]) @ place[: len(moved)]) / length


def path_m(run: RunColumns, person: int) -> float:
    """Length of the hand's path, its position low-passed: steps of an encoder are no motion."""
    hand = run.people[person]
    return float(np.linalg.norm(np.diff(smooth(hand.position_m, hand.rate_hz), axis=0), axis=1).sum())


def tracking_rms_m(run: RunColumns, person: int) -> float | None:
    """Root mean square over time of the distance between the object and its course."""
    wanted = run.course_m
    if wanted is None:
        return None
    return float(np.sqrt(np.mean(np.sum((run.object_m - wanted) ** 2, axis=1))))


def jerk_rms_mps3(run: RunColumns, person: int) -> float | None:
    """Root mean square over time of the third derivative of the hand's position."""
    jerk = _derivative(run, person, 3)
    return None if jerk is None else float(np.sqrt(np.mean(np.sum(jerk**2, axis=1))))


def smoothness(run: RunColumns, person: int) -> float | None:
    """Log dimensionless jerk, -ln(T^3 / v_peak^2 int |jerk|^2 dt): the larger, the smoother; -5.32 of a minimum-jerk stroke.

    T is the time of the run, v_peak the largest speed in it.
    """
    jerk, velocity = _derivative(run, person, 3), _derivative(run, person, 1)
    if jerk is None or velocity is None:
        return None
    rate_hz = run.people[person].rate_hz
    peak = float(np.max(np.linalg.norm(velocity, axis=1)))
    total = float(np.sum(jerk**2)) / rate_hz
    return -log((len(jerk) / rate_hz) ** 3 / peak**2 * total) if peak > 0.0 and total > 0.0 else None


def deviation_m(run: RunColumns, person: int) -> float | None:
    """Largest distance of the hand, low-passed, from the straight way to the goal: in two axes above 0 to its left.

    The way leads from where the hand was at the start by `goal.place_m`. None without that, and in one axis.
    """
    hand = run.people[person]
    return _farthest_across(run, smooth(hand.position_m - hand.position_m[0], hand.rate_hz))


def lateral_force_n(run: RunColumns, person: int) -> float | None:
    """Largest force with which the hand presses, low-passed, across the way of `deviation_m`; signs and None as there."""
    hand = run.people[person]
    return _farthest_across(run, smooth(hand.force_n, hand.rate_hz))


def _farthest_across(run: RunColumns, rows: Array) -> float | None:
    """Return the part across the way to the goal that is largest, of columns of a person, (N, a)."""
    axes = rows.shape[1]
    way = np.zeros(axes)
    way[: len(run.goal.place_m)] = run.goal.place_m[:axes]
    length = float(np.linalg.norm(way))
    if axes == 1 or length == 0.0 or not len(rows):
        return None
    way /= length
    if axes == 2:
        across = rows @ np.array([-way[1], way[0]])
        return float(across[np.argmax(np.abs(across))])
    return float(np.linalg.norm(rows - np.outer(rows @ way, way), axis=1).max())


def mean_force_n(run: RunColumns, person: int) -> float:
    """Mean over time of the size of the force on the hand."""
    return float(np.mean(np.linalg.norm(run.people[person].force_n, axis=1)))


def felt_stiffness_npm(run: RunColumns, person: int) -> float | None:
    """Force with which the hand presses by how far it stands in the object, along the force, at rest at the end.

    How far: from a wall, or from where it stood to a free object at the start. None as `felt_stiffness_missing` says.
    """
    found = _felt_stiffness(run, person)
    return None if isinstance(found, str) else found


def felt_stiffness_missing(run: RunColumns, person: int) -> str | None:
    """Return why there is no felt stiffness, None where there is one."""
    found = _felt_stiffness(run, person)
    return found if isinstance(found, str) else None


def _felt_stiffness(run: RunColumns, person: int) -> float | str:
    """Return the felt stiffness [N/m], or why there is none."""
    hand = run.people[person]
    last = round(REST_S * hand.rate_hz)
    if not run.springs:
        return "a scene has no spring to feel"
    if len(hand.time_s) < 2 * last:
        return f"shorter than {2.0 * REST_S:g} s"
    place = hand.position_m[-last:]
    force = hand.force_n[-last:].mean(axis=0)
    size = float(np.linalg.norm(force))
    if float(np.linalg.norm(place[-1] - place[0])) > REST_MPS * REST_S:
        return f"the hand moved by more than {1e3 * REST_MPS * REST_S:g} mm in the last {REST_S:g} s"
    if size < LEAST_PRESS_N:
        return f"the hand pressed with less than {LEAST_PRESS_N:g} N at the end"
    start_m = hand.position_m[0] if hand.start_m is None else hand.start_m
    begin = start_m + run.object_m[-1] if run.wall_m is None else run.wall_m
    inside = float((place.mean(axis=0) - begin) @ (force / size))
    return size / inside if inside > 0.0 else "the hand did not stand in the object at the end"


def smooth(values: Array, rate_hz: float) -> Array:
    """Return columns through a Gaussian low-pass of MOTION_HZ (-3 dB), which shifts nothing in time.

    Beyond its ends a motion is continued mirrored at a point; what is shorter than the filter stays as it is.
    """
    width = sqrt(log(2.0)) / (2.0 * pi * MOTION_HZ) * rate_hz  # standard deviation, in rows
    half = ceil(_WIDTHS * width)
    if len(values) <= half:
        return values
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / width) ** 2)
    before, after = 2.0 * values[0] - values[half:0:-1], 2.0 * values[-1] - values[-2 : -half - 2 : -1]
    longer = np.concatenate([before, values, after])
    return np.stack([np.convolve(column, kernel / kernel.sum(), "valid") for column in longer.T], axis=1)


def _derivative(run: RunColumns, person: int, order: int) -> Array | None:
    """Return a derivative of the hand's low-passed position, shape (N - order, a)."""
    hand = run.people[person]
    if len(hand.time_s) <= order + 1:
        return None
    return np.diff(smooth(hand.position_m, hand.rate_hz), order, axis=0) * float(hand.rate_hz) ** order
