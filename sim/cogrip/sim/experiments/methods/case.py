"""One session of a comparison, wherever it runs: plain data both ways, so that any process can take it.

Sessions of one method and seed are held against the same session on a clean link, and of one seed against the ideal: a
process keeps the last of these.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from cogrip.protocol.settings import Settings
from cogrip.sim.experiments.methods.felt import furthest_off, measure_felt
from cogrip.sim.experiments.methods.hand import let_rest
from cogrip.sim.experiments.methods.measures import FELT_MEASURES, at_rest, created_at_rest_j, is_oscillating, read
from cogrip.sim.experiments.methods.method import CLEAN, ideal_settings, session_settings
from cogrip.sim.experiments.methods.trace import Array, Trace, Watch, sketch
from cogrip.sim.experiments.sweep.case import Result
from cogrip.sim.experiments.sweep.measures import finite
from cogrip.sim.runs.summary import of_laboratory
from cogrip.sim.session.laboratory import Laboratory


@dataclass(frozen=True, slots=True)
class Job:
    """base: settings as JSON text; rest_s: when the hands begin to rest.

    felt: measure the felt stiffness as well, of each person as `felt` beside the columns; drawn: keep a sketch of the forces,
    as `trace`.
    """

    case: int
    base: str
    method: str
    network: str
    seed: int
    rest_s: float
    felt: bool
    drawn: bool = False


@dataclass(frozen=True, slots=True)
class Session:
    """One that was run."""

    trace: Trace
    summary: dict[str, Any]
    diverged: str


def run_session(settings: Settings, rest_s: float) -> Session:
    """Run it with hands that rest from `rest_s` on."""
    laboratory = Laboratory(settings)
    starts = [let_rest(person.device, person.rates.device_hz, rest_s) for person in laboratory.people]
    watch = Watch(laboratory, starts)
    laboratory.run(watch.each_tick, watch.each_frame)
    return Session(watch.trace(), of_laboratory(laboratory), laboratory.diverged)


@lru_cache(maxsize=1)
def _clean(base: str, method: str, seed: int, rest_s: float) -> Session:
    return run_session(session_settings(json.loads(base), method, CLEAN, seed), rest_s)


@lru_cache(maxsize=1)
def _ideal(base: str, seed: int, rest_s: float) -> Array | None:
    """Forces of the ideal; None where it is not stable itself: K is too much for the device rate."""
    session = run_session(ideal_settings(json.loads(base), seed), rest_s)
    trace = session.trace
    oscillating = is_oscillating(at_rest(trace)[1], 1e3 * created_at_rest_j(trace))
    return None if session.diverged or oscillating else trace.force_n


def run_case(job: Job) -> Result:
    """Run one session. Whatever goes wrong in it is its result: a comparison goes on."""
    try:
        return Result(job.case, _measure(job))
    except Exception as error:  # noqa: BLE001 (kept with the cell, counted and shown)
        return Result(job.case, {}, f"{type(error).__name__}: {error}")


def run_cases(jobs: list[Job]) -> list[Result]:
    return [run_case(job) for job in jobs]


def _measure(job: Job) -> dict[str, Any]:
    clean = _clean(job.base, job.method, job.seed, job.rest_s)
    settings = session_settings(json.loads(job.base), job.method, job.network, job.seed)
    session = clean if job.network == CLEAN else run_session(settings, job.rest_s)
    ideal = _ideal(job.base, job.seed, job.rest_s)
    measures = read(session.trace, session.summary, session.diverged, clean.trace.force_n, ideal)
    people = measure_felt(settings) if job.felt else ()
    furthest = furthest_off(people)
    measures["felt_error_percent"] = furthest.error_percent if furthest else None
    measures["felt_person"] = furthest.person if furthest else None
    found: dict[str, Any] = {name: finite(value) for name, value in measures.items()}
    found["felt"] = [
        {
            "person": person.person,
            "asked_npm": person.asked_npm,
            **{name: finite(getattr(person, name)) for name in FELT_MEASURES},
        }
        for person in people
    ]
    if job.drawn:
        found["trace"] = {"seconds": session.summary["seconds"], "force_n": sketch(session.trace.force_n)}
    return found
