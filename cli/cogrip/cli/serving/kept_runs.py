"""Runs that `cogrip serve` keeps: for how long, how much, and what recordings leave free on the disk."""

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from cogrip.cli.runs.run_folder import live_run_folder
from cogrip.cli.serving.served_rooms import Say
from cogrip.cli.terminal.problem import within
from cogrip.protocol.settings.sections import Settings
from cogrip.server.events import ServerEvent
from cogrip.server.io.loop import FLOOR_BYTES
from cogrip.server.io.run_retention import DAY_S, GB, RunRetention, mark_run

MOST_DAYS, MOST_GB = 36_500.0, 1e6


@dataclass(slots=True)
class Keeping:
    """Flags of what a server leaves: `--into`, else a folder below `--runs`; `--keep-days`, `--keep-gb`, `--free-gb`."""

    runs: Path
    keep_days: float | None
    keep_gb: float | None
    free_gb: float
    into: Path | None = None
    _wanting: bool = field(init=False, default=False)  # whether no folder could be made
    _retention: RunRetention | None = field(init=False, default=None)

    @property
    def given(self) -> dict[str, bool]:
        """Return whether the flags are given, by flag."""
        return {
            "--keep-days": self.keep_days is not None,
            "--keep-gb": self.keep_gb is not None,
            "--free-gb": self.floor_bytes != FLOOR_BYTES,
        }

    @property
    def floor_bytes(self) -> int:
        """Return what recordings leave free."""
        return round(self.free_gb * GB)

    def check(self) -> None:
        """Raise BadInput for a flag that is out of bounds."""
        within("--keep-days", self.keep_days or 0.0, 0.0, MOST_DAYS)
        within("--keep-gb", self.keep_gb or 0.0, 0.0, MOST_GB)
        within("--free-gb", self.free_gb, 0.0, MOST_GB)

    def begin(self, rooms: Sequence[Settings], say: Say, stack: ExitStack) -> Path | None:
        """Return this server's folder, marked, None where none can be made; old ones are removed until `stack` is left."""
        run_folder = self.into or live_run_folder(self.runs, rooms[0].name if len(rooms) == 1 else "rooms", say)
        self._wanting = run_folder is None
        if run_folder is not None:
            try:
                run_folder.mkdir(parents=True, exist_ok=True)
                stack.callback(os.close, mark_run(run_folder))
            except OSError as error:
                say(f"warning: {run_folder}: {error.strerror}; no --keep-days or --keep-gb will remove this run")
        if self.keep_days is None and self.keep_gb is None:
            return run_folder
        keep_s = None if self.keep_days is None else self.keep_days * DAY_S
        keep_bytes = None if self.keep_gb is None else round(self.keep_gb * GB)
        retention = RunRetention(self.runs, lambda text: say(ServerEvent("notice", text)), keep_s, keep_bytes)
        retention.begin()
        stack.callback(retention.close)
        self._retention = retention
        return run_folder

    def degraded(self, record: bool) -> dict[str, str]:
        """Return what is wrong with the runs (`Snapshot.degraded`). record: whether recordings are asked for."""
        found = {"retention": self._retention.trouble} if self._retention is not None else {}
        return {
            **found,
            **({"recording": f"{self.runs}: no folder could be made there"} if record and self._wanting else {}),
        }
