"""Runs and measures of whole sessions in virtual time, shared by tests."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Playout
from cogrip.protocol.wire.accounts import ClientAccount
from cogrip.results.replay.verify import verify
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

FRAME_MS = 1000.0 / 128  # 8 device ticks
MARGINS = ("up_margin_j", "down_margin_j", "line_margin_j")

Table = dict[str, Any]
Row = TypeVar("Row")


def laboratory_of(bare: bool = False, **tables: object) -> Laboratory:
    """Return a session of these settings."""
    return Laboratory(resolve(tables), bare=bare)


def summary_of(bare: bool = False, **tables: object) -> Table:
    """Run a session of these settings to its end, and return its summary."""
    laboratory = laboratory_of(bare, **tables)
    laboratory.run()
    return of_laboratory(laboratory)


def run_frames(laboratory: Laboratory, count: int, each_tick: Callable[[Laboratory], None] | None = None) -> None:
    """Run so many network frames."""
    for _ in range(count):
        laboratory.frame(each_tick)


def by_tick(
    laboratory: Laboratory, row: Callable[[Laboratory], Row], acts: Mapping[int, Callable[[], object]] | None = None
) -> list[Row]:
    """Run a session to its end, and return a row of each tick. acts: what is done at a tick, before its row is taken."""
    rows, acts = list[Row](), acts or {}

    def each_tick(now: Laboratory) -> None:
        if now.tick in acts:
            acts[now.tick]()
        rows.append(row(now))

    laboratory.run(each_tick)
    return rows


def by_frame(laboratory: Laboratory, row: Callable[[Laboratory], Row]) -> list[Row]:
    """Run a session to its end, and return a row of each network frame."""
    rows = list[Row]()
    laboratory.run(each_frame=lambda now: rows.append(row(now)))
    return rows


def account_of(laboratory: Laboratory, number: int = 0) -> ClientAccount:
    """Run a session to its end, close its ledgers, and return the account of a person's client."""
    laboratory.run()
    laboratory.close_ledger()
    account = laboratory.people[number].core.account
    assert account is not None
    return account


def least_margin(summary: Table) -> float:
    """Return by how much the least passivity margin of anybody's line is above what the default credit allows [J]."""
    return float(min(user["energy"][key] + allowed(key) for user in summary["users"] for key in MARGINS))


def allowed(key: str) -> float:
    """Return by how much this margin may be below 0 with the default credit, of which a whole line has two [J]."""
    return 1e-3 * Playout().tank_mj * (2.0 if key == "line_margin_j" else 1.0)


def assert_plays_again(folder: Path) -> None:
    """Hold that every recording of a run plays again, bit by bit."""
    for path in sorted(folder.glob("*.mcap")):
        found = verify(open_recording(path))
        assert found.exact, (path.name, found)
    assert (folder / "server.mcap").exists()
