"""What a running session looks like from outside: its traces read ten times a second, as a table."""

import math
from collections.abc import Sequence
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table

from cogrip.client.safety import STATES
from cogrip.protocol.io.trace import TraceReader
from cogrip.sim.run_folder import ROOM_TRACE, client_trace

_HEADINGS = (
    "person",
    "state",
    "hand\nmm",
    "force\nN",
    "round trip\nms",
    "lost\nframes",
    "late\nticks",
    "energy\nmargin mJ",
)


class LiveTable:
    """Reads the traces of one run folder as they appear; never slows those who write them."""

    def __init__(self, folder: Path, people: Sequence[str]) -> None:
        self._folder = folder
        self._people = people
        self._readers: dict[str, TraceReader] = {}

    def _newest(self, file: str) -> dict[str, float]:
        reader = self._readers.get(file)
        if reader is None:
            try:
                reader = self._readers[file] = TraceReader(self._folder / file)
            except (OSError, ValueError):  # not there yet, or not whole yet
                return {}
        return reader.newest() or {}

    def everyone(self) -> bool:
        """True once every person's client has begun."""
        return all(self._newest(client_trace(name)) for name in self._people)

    def table(self) -> Table:
        """One row a person."""
        room = self._newest(ROOM_TRACE)
        place = " ".join(f"{value * 1e3:+6.1f}" for value in _vector(room, "object_m"))
        table = Table(title=f"object at {place or 'rest'} mm", title_justify="left", box=SIMPLE_HEAD)
        for heading in _HEADINGS:
            table.add_column(heading, justify="left" if heading in ("person", "state") else "right")
        for number, name in enumerate(self._people):
            row = self._newest(client_trace(name))
            if not row:
                table.add_row(name, "joining", *[""] * 6)
                continue
            margin = min(
                row["down_margin_j"], room.get(f"{number}.up_margin_j", 0.0), room.get(f"{number}.line_margin_j", 0.0)
            )
            rtt = row["rtt_ms"]
            table.add_row(
                name,
                STATES[int(row["state"])],
                " ".join(f"{value * 1e3:+6.1f}" for value in _vector(row, "position_m")),
                " ".join(f"{value:+5.2f}" for value in _vector(row, "force_n")),
                "" if math.isnan(rtt) else f"{rtt:.1f}",
                f"{row['lost'] + room.get(f'{number}.lost', 0.0):.0f}",
                f"{row['skipped']:.0f}",
                f"{margin * 1e3:.3f}",
            )
        return table


def _vector(row: dict[str, float], name: str) -> list[float]:
    return [row[f"{name}.{axis}"] for axis in range(3) if f"{name}.{axis}" in row]
