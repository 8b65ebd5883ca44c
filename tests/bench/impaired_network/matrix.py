"""The matrix as a whole: its cases, what each of them must show, and the rows that report them."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from cogrip.experiments.experiment import Result
from cogrip.protocol.settings.types import Seconds, Stiffness

from tests.bench.impaired_network.case import Job, growth

NOTHING_MJ = -1e-9
MOST_PEOPLE = 16
MOST_SEEDS = 10_000
MOST_NPM: float = get_args(Stiffness)[1].le
LEAST_S, MOST_S = 1.0, float(get_args(Seconds)[1].le)
OURS = "wave"
LEAST_GROWTH = 4.0  # powers of ten: a mode that grows by as much in a session leaves every bound
LOOSE_NPM: Mapping[str, Sequence[float]] = {"wave": (100_000.0,), "paper": (5000.0,), "coupling": (2000.0, 5000.0)}
NETWORK_HZ = 128


@dataclass(frozen=True, slots=True)
class Matrix:
    """Every combination is a session; the baselines besides, of as many people, with as many seeds as `loose_seeds` says.

    overrides: of our own sessions. Baselines stand as they are: what they prove is that the matrix can fail.
    """

    networks: tuple[str, ...]
    people: tuple[int, ...]
    stiffness_npm: tuple[float, ...]
    seeds: tuple[int, ...]
    seconds: float
    loose_seeds: int
    overrides: Mapping[str, Any]

    def jobs(self) -> list[Job]:
        """Seed by seed, so that what is cut short has some of everything; sessions of one room stand together: a process keeps
        their clean link."""
        jobs: list[Job] = []
        for seed in self.seeds:
            for people in self.people:
                for K in self.stiffness_npm:
                    for network in self.networks:
                        jobs.append(Job(len(jobs), network, people, K, seed, self.seconds, "", self.overrides))
        for people in self.people:
            for scheme, stiffness in LOOSE_NPM.items():
                overrides = self.overrides if scheme == OURS else {}
                for K in stiffness:
                    for network in self.networks:
                        for seed in self.seeds[: self.loose_seeds]:
                            jobs.append(Job(len(jobs), network, people, K, seed, 8.0, scheme, overrides))
        return jobs


def batch(jobs: Sequence[Job]) -> int:
    """Return how many jobs a process gets together: those of one room on every network."""
    rooms = [(job.people, job.stiffness_npm, job.seed, job.scheme) for job in jobs]
    return rooms.count(rooms[0])


def wrong(job: Job, result: Result) -> str:
    """Return what a session should have shown and did not, "" where all is well."""
    found = result.measures
    if result.error:
        return result.error
    if job.scheme in ("", OURS):
        overpowered = found.get("overpowered", False)
        if found["diverged"] and not overpowered:
            return f"diverged: {found.get('reason') or 'a loose cube'}"
        margin_mj = found["margin_mj"]
        if margin_mj is None:
            return "not passive: no finite margin was kept"
        if not found["passive"] or margin_mj < NOTHING_MJ - 1e3 * _credit_j(job):
            return f"not passive: margin {margin_mj:.3g} mJ"
        if found.get("faults") and not overpowered:
            return f"{found['faults']} in a fault"
        return ""
    if found["radius"] is None:
        return "its model has no finite eigenvalue: whether it must fail is unknown"
    must = growth(found["radius"], job.seconds, NETWORK_HZ) >= LEAST_GROWTH
    if must and not found["restless"]:
        return f"holds, though its mode grows by {found['radius']:.4f} a frame: the matrix could not fail"
    return ""


def _credit_j(job: Job) -> float:
    return job.settings().playout.tank_mj * 1e-3


@dataclass(frozen=True, slots=True)
class Row:
    """Sessions of one network, number of people and stiffness; the worst of each measure, and the median drift.

    overpowered: sessions that ended early, as somebody pushed with more than a device has
    """

    network: str
    people: int
    stiffness_npm: float
    sessions: int
    wrong: int
    overpowered: int
    margin_mj: float
    coherence_rms_mm: float
    coherence_max_mm: float
    drift_mm: float
    median_drift_mm: float
    peak_force_n: float
    force_step_n: float


@dataclass(frozen=True, slots=True)
class LooseRow:
    """Loose cubes of one network, number of people, scheme and stiffness.

    restless: those that swing on, or diverged; growth: powers of ten that the model gives a session.
    """

    network: str
    people: int
    scheme: str
    stiffness_npm: float
    sessions: int
    restless: int
    diverged: int
    radius: float
    growth: float
    wrong: int


def rows(pairs: Iterable[tuple[Job, Result]]) -> tuple[list[Row], list[LooseRow]]:
    """Return the rows of our own scheme, then those of loose cubes, in the order of their first cases."""
    groups: dict[tuple[str, str, int, float], list[tuple[Job, Result]]] = {}
    for job, result in sorted(pairs, key=lambda pair: pair[0].case):
        groups.setdefault((job.scheme, job.network, job.people, job.stiffness_npm), []).append((job, result))
    impaired, cubes = [], []
    for (scheme, network, people, K), group in groups.items():
        bad = sum(bool(wrong(job, result)) for job, result in group)
        found = [result.measures for _, result in group if not result.error]
        if scheme:
            radius = max(_known(found, "radius"))
            grown = growth(radius, group[0][0].seconds, NETWORK_HZ) if found else float("nan")
            restless, diverged = (sum(each[name] for each in found) for name in ("restless", "diverged"))
            cubes.append(LooseRow(network, people, scheme, K, len(group), restless, diverged, radius, grown, bad))
            continue
        drifts = _known(found, "drift_mm")
        impaired.append(Row(
            network, people, K, len(group), bad, sum(bool(each.get("overpowered")) for each in found),
            min(_known(found, "margin_mj")), max(_known(found, "coherence_rms_mm")), max(_known(found, "coherence_max_mm")),
            max(drifts), statistics.median(drifts), max(_known(found, "peak_force_n")), max(_known(found, "force_step_n")),
        ))  # fmt: skip
    return impaired, cubes


def _known(found: Sequence[Mapping[str, Any]], name: str) -> list[float]:
    return [float(each[name]) for each in found if each.get(name) is not None] or [float("nan")]
