"""One session of a comparison, and its measures.

Forces are compared with those of the same method and seed on a clean link, and with those of the ideal of the same seed: a
process keeps the last of each.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from cogrip.analysis.feel.felt_probe import furthest_off, measure_felt
from cogrip.analysis.feel.trace import Array, SessionTrace, TraceRecorder, sketch
from cogrip.experiments.methods.hand import let_rest
from cogrip.experiments.methods.measures import FELT_MEASURES, at_rest, created_at_rest_j, is_oscillating, read
from cogrip.experiments.methods.method import CLEAN, ideal_settings, session_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory


@dataclass(frozen=True, slots=True)
class MethodJob:
    """The number of a case and its session. base: settings as JSON text; rest_s: when the hands begin to rest.

    felt: measure each person's felt stiffness as well, as `felt`; drawn: keep a sketch of the forces, as `trace`.
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
class ComparedSession:
    """A session that was run, up to its first incident: `diverged` says what was unstable, saturated or left, "" for nothing.

    Under the same hands and on the same network another method, or a clean link, has no such incident: what follows it is
    nothing to compare.
    """

    trace: SessionTrace
    summary: dict[str, Any]
    diverged: str


def run_session(settings: Settings, rest_s: float) -> ComparedSession:
    """Run a session with hands that rest from `rest_s` on."""
    laboratory = Laboratory(settings)
    starts = [let_rest(person.device, person.rates.device_hz, rest_s) for person in laboratory.people]
    recorder = TraceRecorder(laboratory, starts)
    laboratory.run(recorder.each_tick, recorder.each_frame, lambda: bool(laboratory.incident))
    return ComparedSession(recorder.trace(), of_laboratory(laboratory), laboratory.incident)


@lru_cache(maxsize=1)
def clean_session(base: str, method: str, seed: int, rest_s: float) -> ComparedSession:
    """Return the session of a method and seed on a clean link."""
    return run_session(session_settings(json.loads(base), method, CLEAN, seed), rest_s)


@lru_cache(maxsize=1)
def ideal_forces(base: str, seed: int, rest_s: float) -> Array | None:
    """Return the forces of the ideal; None where it is unstable itself: K is too large for the device rate."""
    session = run_session(ideal_settings(json.loads(base), seed), rest_s)
    trace = session.trace
    oscillating = is_oscillating(at_rest(trace)[1], 1e3 * created_at_rest_j(trace))
    return None if session.diverged or oscillating else trace.force_n


def measure_case(job: MethodJob) -> dict[str, Any]:
    """Run one session and return its measures."""
    clean = clean_session(job.base, job.method, job.seed, job.rest_s)
    settings = session_settings(json.loads(job.base), job.method, job.network, job.seed)
    session = clean if job.network == CLEAN else run_session(settings, job.rest_s)
    ideal = ideal_forces(job.base, job.seed, job.rest_s)
    measures = read(session.trace, session.summary, session.diverged, clean.trace.force_n, ideal)
    people = measure_felt(settings) if job.felt else ()
    furthest = furthest_off(people)
    measures["felt_error_percent"] = furthest.error_percent if furthest else None
    measures["felt_person"] = furthest.person if furthest else None
    measures["felt"] = [
        {name: getattr(person, name) for name in ("person", "asked_npm", *FELT_MEASURES)} for person in people
    ]
    if job.drawn:
        measures["trace"] = {"seconds": session.summary["seconds"], "force_n": sketch(session.trace.force_n)}
    return measures
