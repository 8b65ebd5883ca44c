"""The query of a comparison: every method on every network, with every seed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec

from cogrip.devices.for_user import make_for
from cogrip.devices.simulated.device import SimulatedDevice
from cogrip.experiments.experiment import Kind, Measure, Result
from cogrip.experiments.folder import FILES
from cogrip.experiments.methods.case import Job, measure_case
from cogrip.experiments.methods.hand import FADE_S
from cogrip.experiments.methods.measures import COLUMNS, LAST_S
from cogrip.experiments.methods.method import (
    CLEAN,
    METHODS,
    ChoiceError,
    described,
    ideal_settings,
    session_settings,
)
from cogrip.protocol.settings.room import seat_axes
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.table import SettingsError
from cogrip.protocol.version import VERSION
from cogrip.sim.input_files import files_read

COMPARISON = Kind("comparison", "comparison.json")
MOST_SESSIONS = 100_000
FELT_SEEDS = 5
DRAWN_SEEDS = 20  # number of seeds with a sketch of forces, which takes some kB of cells.jsonl
REST_SHARE, LEAST_REST_S, MOST_REST_S = 0.3, FADE_S + LAST_S, 3.0


@dataclass(frozen=True, slots=True)
class Comparison:
    """A checked query. Cases run over networks fastest, then methods, then seeds; the clean link is the first network.

    rest_s: when the hands begin to rest; files: digests of the files that sessions read, by path.
    """

    base: Mapping[str, Any]
    methods: tuple[str, ...]
    networks: tuple[str, ...]
    seeds: tuple[int, ...]
    rest_s: float
    files: Mapping[str, str]
    kind: Kind = COMPARISON
    columns: tuple[str, ...] = COLUMNS
    measure: Measure = measure_case

    @property
    def keys(self) -> tuple[str, ...]:
        """The names of a case's values."""
        return "method", "network", "seed"

    @property
    def cases(self) -> int:
        return len(self.seeds) * len(self.methods) * len(self.networks)

    def values(self, case: int) -> dict[str, Any]:
        """Return method, network and seed of a case."""
        seed_method, network = divmod(case, len(self.networks))
        seed, method = divmod(seed_method, len(self.methods))
        return {"method": self.methods[method], "network": self.networks[network], "seed": self.seeds[seed]}

    @property
    def query(self) -> dict[str, Any]:
        """See `Experiment.query`: with a method or network that has changed it is another comparison."""
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
            "columns": list(self.columns),
            FILES: dict(self.files),
        }

    def jobs(self, finished: Mapping[int, Result]) -> list[Job]:
        """Return the cases still to be run. FELT_SEEDS seeds have the felt stiffness, DRAWN_SEEDS a sketch of forces."""
        base, felt, drawn = json.dumps(self.base), self.seeds[:FELT_SEEDS], self.seeds[:DRAWN_SEEDS]
        return [
            Job(case, base, method, network, seed, self.rest_s, felt=seed in felt, drawn=seed in drawn)
            for case in range(self.cases)
            if case not in finished
            for method, network, seed in [self.values(case).values()]
        ]

    @property
    def batch(self) -> int:
        """The jobs of one method and seed, all networks: one process runs their clean link once."""
        return len(self.networks)


def prepare(settings: Settings, methods: Sequence[str], networks: Sequence[str], seeds: int) -> Comparison:
    """Check a query; nothing is run. Seeds are the settings' own and those after it.

    Raises ChoiceError for what cannot be compared.
    """
    if seeds < 1:
        raise ChoiceError(f"{seeds} seeds: at least 1 is needed")
    for user in settings.users:
        if not isinstance(make_for(user, seat_axes(settings, user)), SimulatedDevice):
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
    base, first = msgspec.to_builtins(settings), settings.seed
    comparison = Comparison(base, tuple(methods), networks, tuple(range(first, first + seeds)), rest_s, {})
    files: dict[str, str] = {}
    for method in methods:
        for network in networks:
            try:
                files |= files_read(session_settings(base, method, network, first))
            except SettingsError as error:
                raise ChoiceError(f"{method} on {network}: {error}") from None
    try:
        ideal_settings(base, first)
    except SettingsError as error:
        raise ChoiceError(f"the object in the hands, without a network: {error}") from None
    return replace(comparison, files=dict(sorted(files.items())))
