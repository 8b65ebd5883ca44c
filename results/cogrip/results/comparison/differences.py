"""Comparison of runs with the first of them: the numbers of their summaries, and the settings that differ."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cogrip.results.comparison.common_stretch import common_stretch_s, length_s, summary_of_first
from cogrip.results.reading.summary_values import UNKNOWN, Summary, dig, energy, is_number, name_of, number, people
from cogrip.results.reading.traces import TracedRun

MOST_RUNS = 12  # most runs that are compared: more colours are not told apart
NOT_SET = "not set"


class ComparisonError(ValueError):
    """Raised for runs that cannot be compared; the text says why, and the cure."""


class Quantity(NamedTuple):
    """A number of a summary: its place below a person (or below the top), and how to show it. No unit: an energy."""

    key: str
    what: str
    unit: str = ""
    scale: float = 1.0
    digits: int = 1
    missing: str = UNKNOWN

    def of(self, table: Any) -> float | None:
        value = dig(table, *self.key.split("."))
        return float(value) if is_number(value) else None

    def show(self, value: float | None) -> str:
        if value is None:
            return self.missing
        return number(value, scale=self.scale, digits=self.digits) if self.unit else energy(value)


_PERSON = (
    Quantity("peak_force_n", "peak force", "N", digits=2),
    Quantity("travel_m", "travel", "mm", 1e3),
    Quantity("felt_stiffness_npm", "felt stiffness", "N/m", digits=0, missing="not measured"),
    Quantity("predicted_stiffness_npm", "predicted stiffness", "N/m", digits=0),
    Quantity("energy.up_reserve_j", "least reserve up, after 1 s"),
    Quantity("energy.down_reserve_j", "least reserve down, after 1 s"),
    Quantity("energy.line_reserve_j", "least reserve line, after 1 s"),
    Quantity("energy.device_reserve_j", "least reserve port, after 1 s"),
    Quantity("energy.up_margin_j", "least margin of the line up"),
    Quantity("energy.down_margin_j", "least margin of the line down"),
    Quantity("energy.line_margin_j", "least margin of the whole line"),
    Quantity("energy.device_margin_j", "least margin of the device port"),
    Quantity("leak_j", "leak of the device port"),
    Quantity("at_limit", "force at a limit", "% of ticks", 100.0),
    Quantity("link.lost", "lost", "frames", digits=0),
    Quantity("link.late", "late", "frames", digits=0),
    Quantity("link.rtt_ms.p50", "round trip, median", "ms"),
    Quantity("link.rtt_ms.p99", "round trip, 99 %", "ms"),
)
_ALL = (Quantity("object.travel_m", "travel", "mm", 1e3), Quantity("seconds", "length", "s"))


class RunDifference(NamedTuple):
    """One number in every run, in the units of summary.json; who: a person, or "" for the object and the run."""

    who: str
    quantity: Quantity
    values: tuple[float | None, ...]

    def change(self, number: int) -> float | None:
        """Return the difference of run `number` to the first; None where one of them does not tell."""
        first, other = self.values[0], self.values[number]
        return None if first is None or other is None else other - first

    def shown(self) -> list[str]:
        """Return the values as a table shows them, and words where there is none."""
        return [self.quantity.show(value) for value in self.values]

    def shown_change(self, number: int) -> str:
        """Return `=` where nothing changed, else the difference with its sign, and in percent of the first run's value."""
        change, first = self.change(number), self.values[0]
        if change is None or first is None:
            return ""
        if not change:
            return "="
        if not self.quantity.unit:
            text = energy(change)
            return "=" if text == "0 J" else text if change < 0.0 else f"+{text}"
        scaled = change * self.quantity.scale
        text = f"{scaled:+z.0f}" if abs(scaled) >= 100.0 else f"{scaled:+.3g}"
        if first:
            percent = 100.0 * change / abs(first)
            text += f" ({percent:+z.0f} %)" if abs(percent) >= 100.0 else f" ({percent:+z.1f} %)"
        return text.replace("-", "−")


class SettingsDifference(NamedTuple):
    """A setting that is not the same in all runs, by the name that `--set` gives it; NOT_SET where it does not stand."""

    key: str
    values: tuple[Any, ...]


def labels_of(folders: Sequence[Path]) -> list[str]:
    """Return what to call runs: their folders' names, or whole paths where two have one name."""
    names = [folder.resolve().name for folder in folders]
    return names if len(set(names)) == len(names) else [str(folder) for folder in folders]


def check_comparable(runs: Sequence[TracedRun], labels: Sequence[str]) -> list[str]:
    """Return the people whom all runs have in common, in the order of the first one's seats. Raises ComparisonError."""
    if not 2 <= len(runs) <= MOST_RUNS:
        raise ComparisonError(f"{len(runs)} runs cannot be compared; name 2 to {MOST_RUNS} of them")
    for what, of in (("axes", axes_of), ("kind", object_of)):
        known = [(label, value) for run, label in zip(runs, labels, strict=True) if (value := of(run)) is not None]
        for label, value in known[1:]:
            if value != known[0][1]:
                raise ComparisonError(
                    f"{label} cannot be compared with {known[0][0]}: its object.{what} is {value!r}, not "
                    f"{known[0][1]!r}; compare runs in which it is the same"
                )
    for run, label in zip(runs[1:], labels[1:], strict=True):
        if not set(runs[0].names) & set(run.names):
            raise ComparisonError(
                f"{label} cannot be compared with {labels[0]}: nobody held on in both; its people are "
                f"{', '.join(run.names) or 'not known'}, not {', '.join(runs[0].names) or 'known'}"
            )
    everywhere = [name for name in runs[0].names if all(name in run.names for run in runs)]
    if not everywhere:
        raise ComparisonError(f"{', '.join(labels)} cannot be compared: nobody held on in all of them")
    return everywhere


def axes_of(run: TracedRun) -> int | None:
    """Return the number of axes, by the settings or else the recordings."""
    axes = dig(run.settings, "object", "axes")
    if isinstance(axes, int):
        return axes
    trace = run.room or next(iter(run.clients.values()), None)
    if trace is None:
        return None
    return int(trace.columns["object_m"].shape[1])


def object_of(run: TracedRun) -> str | None:
    """Return the kind of the object, where the settings tell."""
    kind = dig(run.settings, "object", "kind")
    return kind if isinstance(kind, str) else None


def differences(summaries: Sequence[Summary], names: Sequence[str] | None = None) -> list[RunDifference]:
    """Return every number that the summaries tell, side by side: the run's, then those of each person.

    names: whose; else those of everybody who is in all the summaries that name anybody.
    """
    tables = [{name_of(user): user for user in people(summary)} for summary in summaries]
    if names is None:
        known = [table for table in tables if table]
        names = [name for name in (known[0] if known else ()) if all(name in table for table in known)]
    rows = [RunDifference("", quantity, tuple(quantity.of(summary) for summary in summaries)) for quantity in _ALL]
    for name in names:
        rows += [
            RunDifference(name, quantity, tuple(quantity.of(table.get(name)) for table in tables))
            for quantity in _PERSON
        ]
    return rows


def differences_of_runs(
    runs: Sequence[TracedRun], labels: Sequence[str], names: Sequence[str] | None = None
) -> tuple[list[RunDifference], list[str]]:
    """Return `differences` of runs, and what a reader has to know of them.

    Of runs that are not equally long they are over the stretch that all have, as far as the recordings tell it.
    """
    stretch_s = common_stretch_s(runs)
    if stretch_s is None:
        return differences([run.summary for run in runs], names), []
    rows = differences([summary_of_first(run, stretch_s) for run in runs], names)
    lengths = "; ".join(
        f"{label}: {number(length_s(run), digits=2)} s" for run, label in zip(runs, labels, strict=True)
    )
    note = (
        f"Not equally long ({lengths}). All numbers but the length are of the first {number(stretch_s, digits=2)} s, which "
        "all have; what the recordings do not tell of a part of a run is left out."
    )
    return [row for row in rows if any(value is not None for value in row.values)], [note]


def settings_differences(settings: Sequence[dict[str, Any]]) -> list[SettingsDifference]:
    """Return the settings that differ, in the order of the first settings that have them."""
    flat = [dict(_flat(table, "")) for table in settings]
    keys = dict.fromkeys(key for table in flat for key in table)
    rows = [SettingsDifference(key, tuple(table.get(key, NOT_SET) for table in flat)) for key in keys]
    return [row for row in rows if any(value != row.values[0] for value in row.values)]


def _flat(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield (`section.key`, value) of everything below; an empty table or list yields nothing."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list | tuple) else None
    if parts is None:
        yield path, value
        return
    for key, inner in parts:
        yield from _flat(inner, f"{path}.{key}" if path else str(key))
