"""What a running session looks like from outside: its recordings followed ten times a second, as a table."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cogrip.cli.runs.reserve_columns import HEADING_NOW, reserves_now
from cogrip.cli.session.followed import FollowedRun, components
from cogrip.cli.terminal.tables import Fitted, shortened

_HAND = ("hand\nmm", "force\nN", HEADING_NOW)
_NETWORK = ("round\ntrip ms", "up, down\nms", "lost\nframes", "late\nticks")
_NAME_WIDTH = 12


class LiveTable:
    """Reads the recordings of one run folder as they grow; never slows those who write them."""

    def __init__(self, folder: Path, room: str, people: Sequence[str]) -> None:
        self._run = FollowedRun(folder)
        self._room = room
        self._people = people

    def everyone(self) -> bool:
        """True once every person's client has begun."""
        return all(self._run.tick(name) for name in self._people)

    def table(self) -> Group:
        """One row a person; what does not fit beside each other stands in two tables."""
        step = self._run.step(self._room)
        place = " ".join(components(step.object_m, 1e3, "+.1f")) if step else ""
        vectors: list[tuple[list[str], list[str]]] = []
        people: list[list[str]] = []
        reserves: list[str] = []
        network: list[list[str]] = []
        for number, name in enumerate(self._people):
            tick = self._run.tick(name)
            if tick is None:
                people.append([name, "joining"])
                vectors.append(([], []))
                reserves.append("")
                network.append([""] * len(_NETWORK))
                continue
            seat = step.seats[number] if step else None
            people.append([name, tick.state])
            vectors.append((components(tick.position_m, 1e3, "+6.1f"), components(tick.force_n, 1.0, "+5.2f")))
            reserves.append(reserves_now(tick, seat))
            network.append(
                [
                    "" if tick.rtt_ms is None else f"{tick.rtt_ms:.1f}",
                    " ".join(f"{direction:.1f}" for direction in (tick.up_ms, tick.down_ms) if direction is not None),
                    f"{tick.lost + (seat.lost if seat else 0)}",
                    f"{tick.skipped}",
                ]
            )

        def hands(between: str) -> list[list[str]]:
            return [
                [between.join(hand), between.join(force), reserve]
                for (hand, force), reserve in zip(vectors, reserves, strict=True)
            ]

        def side_by_side() -> list[Table]:
            return [live_table((*_HAND, *_NETWORK), people, [a + b for a, b in zip(hands(" "), network, strict=True)])]

        def two(between: str) -> list[Table]:
            return [live_table(_HAND, people, hands(between)), live_table(_NETWORK, people, network)]

        return Group(Text(f"object at {place or 'rest'} mm"), Fitted(side_by_side, lambda: two(" "), lambda: two("\n")))


def live_table(headings: Sequence[str], people: Sequence[Sequence[str]], cells: Sequence[Sequence[str]]) -> Table:
    """A row a person: name, state, then numbers."""
    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("\nperson", no_wrap=True)
    table.add_column("\nstate", no_wrap=True)
    for heading in headings:
        table.add_column(Text(heading), justify="right", no_wrap=True)
    for (name, state), row in zip(people, cells, strict=True):
        tint = {"fault": "red", "degraded": "yellow"}.get(state, "")
        table.add_row(Text(shortened(name, _NAME_WIDTH)), Text(state, style=tint), *map(Text, row))
    return table
