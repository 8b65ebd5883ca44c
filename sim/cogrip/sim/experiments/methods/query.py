"""A comparison from its question to its table: every method on every network, with every seed; what is finished is kept."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import msgspec

from cogrip.devices.for_user import make_for
from cogrip.devices.simulated.device import SimulatedDevice
from cogrip.protocol.settings import Settings
from cogrip.protocol.settings_table import SettingsError
from cogrip.protocol.version import VERSION
from cogrip.sim.experiments.methods.case import Job
from cogrip.sim.experiments.methods.hand import FADE_S
from cogrip.sim.experiments.methods.measures import COLUMNS, LAST_S
from cogrip.sim.experiments.methods.method import (
    CLEAN,
    METHODS,
    ChoiceError,
    described,
    ideal_settings,
    session_settings,
)
from cogrip.sim.experiments.sweep.case import Result
from cogrip.sim.experiments.sweep.folder import FILES, Kind, SweepFolder
from cogrip.sim.session.input_files import files_read

COMPARISON = Kind("comparison", "comparison.json")
MOST_SESSIONS = 100_000
FELT_SEEDS = 5
REST_SHARE, LEAST_REST_S, MOST_REST_S = 0.3, FADE_S + LAST_S, 3.0


class Workers(Protocol):
    """Whoever runs cells."""

    def run(self, jobs: Sequence[Job]) -> Iterator[Result]: ...


@dataclass(frozen=True, slots=True)
class Comparison:
    """A checked question. Cells run over networks fastest, then methods, then seeds; the clean link is the first network."""

    base: Mapping[str, Any]
    methods: tuple[str, ...]
    networks: tuple[str, ...]
    seeds: tuple[int, ...]
    rest_s: float
    files: Mapping[str, str]  # that sessions read, and the digest of what stands there

    @property
    def keys(self) -> tuple[str, ...]:
        """What names a cell."""
        return "method", "network", "seed"

    @property
    def cases(self) -> int:
        return len(self.seeds) * len(self.methods) * len(self.networks)

    def values(self, case: int) -> dict[str, Any]:
        """Method, network and seed of a cell."""
        rest, network = divmod(case, len(self.networks))
        seed, method = divmod(rest, len(self.methods))
        return {"method": self.methods[method], "network": self.networks[network], "seed": self.seeds[seed]}

    @property
    def asked(self) -> dict[str, Any]:
        """What makes this comparison this one and no other: a method or network that has changed is another one."""
        return {
            "version": VERSION,
            "settings": dict(self.base),
            "methods": {name: dict(METHODS[name].overrides) for name in self.methods},
            "networks": {
                name: described(session_settings(self.base, self.methods[0], name, self.seeds[0]))
                for name in self.networks
            },
            "seeds": list(self.seeds),
            "rest_s": self.rest_s,
            "columns": list(COLUMNS),
            FILES: dict(self.files),
        }

    def jobs(self, finished: Mapping[int, Result]) -> list[Job]:
        """What is still to be run. The felt stiffness is measured with the first FELT_SEEDS seeds, forces are drawn of one."""
        base, felt = json.dumps(self.base), self.seeds[:FELT_SEEDS]
        return [
            Job(case, base, method, network, seed, self.rest_s, felt=seed in felt, drawn=seed == self.seeds[0])
            for case in range(self.cases)
            if case not in finished
            for method, network, seed in [self.values(case).values()]
        ]

    def at_once(self, jobs: Sequence[Job]) -> int:
        """All networks of one method and seed go to one process, which runs their clean link once."""
        return len(self.networks)


def prepare(settings: Settings, methods: Sequence[str], networks: Sequence[str], seeds: int) -> Comparison:
    """Seeds are the settings' own and those after it. Raises ChoiceError for what cannot be compared; nothing is run."""
    if seeds < 1:
        raise ChoiceError(f"{seeds} seeds: at least 1 is needed")
    for user in settings.users:
        if not isinstance(make_for(user, settings.object.axes), SimulatedDevice):
            raise ChoiceError(
                f"{user.name}: {user.device}: the same hand is held under every method, so it has to be a simulated device; "
                "take sim:phantom or sim:ideal, with a recorded hand as csv:FILE if you like"
            )
    if settings.seconds < 2.0 * LEAST_REST_S:
        raise ChoiceError(
            f"seconds = {settings.seconds:g} is too short: hands need {LEAST_REST_S:g} s to come to rest in the end, to be "
            f"judged there; give at least {2.0 * LEAST_REST_S:g}"
        )
    rest_s = settings.seconds - min(MOST_REST_S, max(LEAST_REST_S, REST_SHARE * settings.seconds))
    networks = (CLEAN, *(name for name in networks if name != CLEAN))
    sessions = len(methods) * len(networks) * seeds
    if sessions > MOST_SESSIONS:
        raise ChoiceError(f"{sessions} sessions are more than {MOST_SESSIONS}: give fewer seeds, methods or profiles")
    asked = Comparison(
        msgspec.to_builtins(settings),
        tuple(methods),
        networks,
        tuple(range(settings.seed, settings.seed + seeds)),
        rest_s,
        {},
    )
    files: dict[str, str] = {}
    for method in asked.methods:
        for network in asked.networks:
            try:
                files |= files_read(session_settings(asked.base, method, network, asked.seeds[0]))
            except SettingsError as error:
                raise ChoiceError(f"{method} on {network}: {error}") from None
    try:
        ideal_settings(asked.base, asked.seeds[0])
    except SettingsError as error:
        raise ChoiceError(f"the object in the hands, without a network: {error}") from None
    return replace(asked, files=dict(sorted(files.items())))


def run_comparison(
    asked: Comparison, folder: SweepFolder, workers: Workers, progress: Callable[[int], None] = lambda finished: None
) -> int:
    """Run the cells that the folder does not have, keep each as it comes, write table.csv; returns how many were run."""
    kept = len(folder.finished)
    progress(kept)
    try:
        for result in workers.run(asked.jobs(folder.finished)):
            folder.add(result, asked.values(result.case))
            progress(len(folder.finished))
    finally:
        folder.write_table(asked, COLUMNS)
        folder.close()
    return len(folder.finished) - kept
