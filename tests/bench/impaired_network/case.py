"""One session of the matrix, wherever it runs: plain data in and out, so that any process can take it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from cogrip.analysis.feel.trace import TraceRecorder
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import linear_session
from cogrip.analysis.linear.stability import verdict
from cogrip.experiments.methods.hand import let_rest
from cogrip.experiments.methods.measures import at_rest, created_j, furthest, largest
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.summary_values import people, worst_margin
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.bench.impaired_network.room import CLEAN, impaired, loose, settled

REST_S = 3.0  # at the end, or in its second half, in which hands hold where they began
RESTLESS_N = 1.0  # swing of a force long after the push
PUSHED = 0.9  # of a device's peak force, and of the ticks at it: a person who pushes so is stronger than the device


@dataclass(frozen=True, slots=True)
class Job:
    """scheme: of a loose cube (`room.loose`), "" for ours on an impaired network; overrides: settings by their path."""

    case: int
    network: str
    people: int
    stiffness_npm: float
    seed: int
    seconds: float
    scheme: str = ""
    overrides: Mapping[str, Any] = field(default_factory=dict)

    def settings(self, network: str | None = None) -> Settings:
        """Raises SettingsError."""
        given = network or self.network, self.people, self.stiffness_npm, self.seed, self.seconds
        table = loose(*given, self.scheme) if self.scheme else impaired(*given)
        return settled(table, self.overrides)


def measure_case(job: Job) -> dict[str, Any]:
    """Run one session and return its measures."""
    return _loose(job) if job.scheme else _impaired(job)


class Pushes:
    """How long the force on each person is at the device's peak, and for how many of these ticks the hand itself pushes so."""

    def __init__(self, laboratory: Laboratory) -> None:
        self._at_peak = [0] * len(laboratory.people)
        self._pushed = [0] * len(laboratory.people)

    def each_tick(self, laboratory: Laboratory) -> None:
        """Look at the force that was asked for in this tick, and at the hand."""
        for number, person in enumerate(laboratory.people):
            if not person.core.safety.at_peak():
                continue
            device: Any = person.device
            hand = device.hand
            own = zip(hand.drive(person.core.tick), device.position_m, device.velocity_mps, strict=True)
            push_n = math.hypot(*[n - hand.stiffness_npm * x - hand.damping_nspm * v for n, x, v in own])
            self._at_peak[number] += 1
            self._pushed[number] += push_n >= PUSHED * person.core.capability.peak_force_n

    def overpowered(self, laboratory: Laboratory) -> bool:
        """Return whether each hand that was let go for good had pushed with more than its device has, and did not oscillate."""
        faults = [n for n, person in enumerate(laboratory.people) if person.core.safety.state == "fault"]
        return bool(faults) and all(
            self._pushed[n] >= PUSHED * self._at_peak[n] > 0 and not laboratory.people[n].core.port.oscillates
            for n in faults
        )


def rest_from_s(seconds: float) -> float:
    """Return the time at which the hands of a session of this length begin to rest [s]."""
    return max(0.5 * seconds, seconds - REST_S)


def gaps_m(summary: Mapping[str, Any]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the distance of each hand from its proxy [m], (n, axes)."""
    return np.array([np.subtract(user["position_m"], user["proxy_m"]) for user in summary["users"]])


def _run(settings: Settings, seconds: float) -> tuple[Laboratory, dict[str, Any], TraceRecorder, bool]:
    laboratory = Laboratory(settings)
    starts = [let_rest(person.device, person.rates.device_hz, rest_from_s(seconds)) for person in laboratory.people]
    watch, pushes = TraceRecorder(laboratory, starts), Pushes(laboratory)

    def each_tick(running: Laboratory) -> None:
        watch.each_tick(running)
        pushes.each_tick(running)

    laboratory.run(each_tick, watch.each_frame)
    return laboratory, of_laboratory(laboratory), watch, pushes.overpowered(laboratory)


@lru_cache(maxsize=8)
def _clean_gaps(
    people: int, stiffness_npm: float, seed: int, seconds: float, overrides: tuple[tuple[str, Any], ...]
) -> Any:
    job = Job(0, CLEAN, people, stiffness_npm, seed, seconds, "", dict(overrides))
    return gaps_m(_run(job.settings(), seconds)[1])


def _impaired(job: Job) -> dict[str, Any]:
    """drift_mm: how far hand and proxy have come apart at the end, where hands rest, beyond what they do on a clean link;

    overpowered: a hand was let go for good, rightly, as it pushed with more than its device has (`Pushes`).
    """
    laboratory, summary, watch, overpowered = _run(job.settings(), job.seconds)
    trace, users = watch.trace(), people(summary)
    worst = worst_margin(users)
    rms, most = furthest(trace.view_m)
    measures = {
        "passive": summary["passive"],
        "diverged": bool(laboratory.incident),
        "reason": laboratory.incident,
        "faults": sum(user["state"] == "fault" for user in users),
        "overpowered": overpowered,
        "margin_mj": worst[0] * 1e3 if worst else None,
        "balance_mj": summary["server"]["energy_balance_error_j"] * 1e3,
        "created_mj": created_j(trace.work_j, trace.object_j) * 1e3,
        "peak_force_n": largest(user["peak_force_n"] for user in users),
        "force_step_n": largest(user["peak_force_step_n"] for user in users),
        "coherence_rms_mm": rms * 1e3,
        "coherence_max_mm": most * 1e3,
        "drift_mm": None,
    }
    if not laboratory.incident:
        clean = _clean_gaps(job.people, job.stiffness_npm, job.seed, job.seconds, tuple(job.overrides.items()))
        measures["drift_mm"] = float(np.abs(gaps_m(summary) - clean).max()) * 1e3
    return measures


def _loose(job: Job) -> dict[str, Any]:
    """radius: the largest eigenvalue's size of one frame on a link of the same delay, with everybody's hand in the model;

    restless: it diverged, or forces swing on long after the push, up to the devices' limits.
    """
    settings = job.settings()
    laboratory = Laboratory(settings)
    watch = TraceRecorder(laboratory, [(0.0,) * settings.object.axes for _ in settings.users])
    laboratory.run(watch.each_tick, watch.each_frame)
    summary = of_laboratory(laboratory)
    worst = worst_margin(people(summary))
    swing_n = at_rest(watch.trace())[1]
    return {
        "passive": summary["passive"],
        "diverged": bool(laboratory.incident),
        "restless": bool(laboratory.incident) or swing_n > RESTLESS_N,
        "swing_n": swing_n,
        "margin_mj": worst[0] * 1e3 if worst else None,
        "radius": radius(settings),
    }


def radius(settings: Settings) -> float:
    """Return the largest eigenvalue of the session's linear model, without those that the structure puts at 1."""
    return verdict(LiftedModel(linear_session(settings, hands=True))).decaying


def growth(radius: float, seconds: float, network_hz: int) -> float:
    """By how many powers of ten the fastest mode grows in a session."""
    return seconds * network_hz * math.log10(max(radius, 1e-300))
