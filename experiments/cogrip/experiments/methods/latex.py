"""The table of a comparison in LaTeX: booktabs, symbols over a row of units, the best of each network in bold.

A number is the median over seeds, with the quartiles as index and exponent where they differ from it as printed. It fits
`\\textwidth` of two columns in `\\footnotesize`, and needs booktabs alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cogrip.experiments.methods.method import CLEAN, METHODS
from cogrip.experiments.methods.table import (
    BOUNDS,
    FELT,
    NONE,
    TABLE,
    TableColumn,
    columns_of,
    credits_of,
    decimals,
    feels,
    first_seeds,
    judgements,
    unstable,
)

Row = Mapping[str, Any]
LABEL = "tab:methods"
_SYMBOLS = {column.measure: column.symbol for column in TABLE}
_UNSTABLE = {"diverged": "div.", "oscillates": "osc."}
_NOT_PASSIVE = {"not_passive": "n.p."}
_TO_ITSELF = "error_clean_n"  # measure that is 0 by definition on the clean link


def latex(summary: Mapping[str, Any]) -> str:
    """Return the whole table environment."""
    columns = columns_of(summary)
    symbols = [f"${column.symbol}$" for column in columns]
    lines = [
        "% \\usepackage{booktabs}",
        "\\begin{table*}",
        "\\centering",
        f"\\caption{{{_caption(summary)}}}",
        f"\\label{{{LABEL}}}",
        "\\footnotesize",
        "\\setlength{\\tabcolsep}{3pt}",
        f"\\begin{{tabular}}{{@{{}}lll{'r' * len(columns)}@{{}}}}",
        "\\toprule",
        _line(["Network", "Method", "Verdict", *symbols]),
        _line(["", "", "", *(f"({_escaped(column.unit)})" for column in columns)]),
    ]
    for network in dict.fromkeys(row["network"] for row in summary["rows"]):
        rows = [row for row in summary["rows"] if row["network"] == network]
        best = {column.measure: _best(rows, column) for column in columns}
        lines.append("\\midrule")
        for number, row in enumerate(rows):
            numbers = [_number(row, column, row["method"] in best[column.measure]) for column in columns]
            name = "" if number else _escaped(network)
            lines.append(_line([name, _escaped(METHODS[row["method"]].title), _verdict(row), *numbers]))
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", "\\end{table*}", ""])


def _line(cells: Sequence[str]) -> str:
    return f"{' & '.join(cells)} \\\\"


def _caption(summary: Mapping[str, Any]) -> str:
    asked = summary["asked"]
    seeds, people = len(asked["seeds"]), len(asked["settings"]["users"])
    if seeds > 1:
        numbers = f"Median over {seeds} seeds, first and third quartile as index and exponent where they differ from it"
    else:
        numbers = "One seed"
    what = {
        "created_mj": "energy that came out of the network and no hand had put in",
        "peak_force_n": "largest force on a hand",
        "force_step_n": "its largest change in one device tick",
        "coherence_rms_mm": "distance between the object's positions as reported to two people, rms over time",
        "coherence_max_mm": "its maximum",
        "rest_mm": "distance left between hands at rest",
        "rest_swing_n": "swing of a force between hands at rest",
        FELT: f"$K_{{\\mathrm{{felt}}}}/K-1$ under a static load, of the person with the largest{first_seeds(seeds)}",
        _TO_ITSELF: "rms difference of forces to the same method on the clean link",
        "error_ideal_n": "rms difference of forces to the object directly in the hands, by $K$ and $B$ at the device rate",
        "contact_n": "largest normal force at a tool",
        "slip_mm": "slip of a tool while the object is lifted",
        "lifted_mm": "greatest height of the object",
        "lifted_s": "time for which it is lifted",
    }
    symbols = "; ".join(f"${column.symbol}$: {what[column.measure]}" for column in columns_of(summary))
    return (
        f"Methods compared, {people} {'people' if people > 1 else 'person'}, {asked['settings']['seconds']:g}~s a session. "
        f"{numbers}. {symbols}. Bold: least in absolute value of the methods that are stable on that network. "
        f"--: not measured, or at least half of the sessions diverged; of ${_SYMBOLS[FELT]}$ also where at least half diverged "
        "or oscillate, or at least half of the probes never came to rest. div.: sessions that diverged, and when (median); "
        f"osc.: sessions that oscillate; n.p.: sessions that are not passive. {_escaped(BOUNDS)}. "
        f"{_escaped(credits_of(summary, lambda method: METHODS[method].title))}"
    )


def _verdict(row: Row) -> str:
    words = judgements(row, _UNSTABLE, _NOT_PASSIVE, " ({:.2g}~s)")
    if row["failed"]:
        words.append(f"not run {row['failed']}")
    return ", ".join(words) or "--"


def _hidden(row: Row, column: TableColumn) -> bool:
    """Return whether a number is not shown: of a session that diverged only `created_mj` means anything."""
    if column.measure == FELT and (unstable(row) or not feels(row[FELT])):
        return True
    return column.measure != "created_mj" and bool(row["runs"]) and 2 * row["diverged"] >= row["runs"]


def _best(rows: Sequence[Row], column: TableColumn) -> set[str]:
    """Return the methods whose median is least, as printed; none where fewer than two compare, or all are equal."""
    if not column.ranked:
        return set()
    found = {
        row["method"]: (size, _print(size, column))
        for row in rows
        if row[column.measure] is not None and row["runs"] and not unstable(row) and not _hidden(row, column)
        for size in [abs(row[column.measure]["median"])]
    }
    if len({text for _, text in found.values()}) < 2 or (column.measure == _TO_ITSELF and rows[0]["network"] == CLEAN):
        return set()
    _, least = min(found.values())
    return {method for method, (_, text) in found.items() if text == least}


def _number(row: Row, column: TableColumn, bold: bool) -> str:
    found = row[column.measure]
    if found is None or _hidden(row, column):
        return "--"
    median, first, third = (_print(found[name], column) for name in ("median", "q1", "q3"))
    alone = first == median == third or "^" in f"{first}{median}{third}"  # of powers of ten the order is what counts
    spread = "" if alone else f"_{{{first}}}^{{{third}}}"
    shown = f"\\mathbf{{{median}}}" if bold else median
    return f"${shown}{spread}$"


def _print(value: float, column: TableColumn) -> str:
    """Return three digits in TeX mathematics; a power of ten from 1e4 on."""
    if column.measure == FELT:
        return f"{value:.1f}".replace("-0.0", "0.0")
    if round(abs(value)) >= 1e4:
        digits, _, power = f"{value:.1e}".partition("e")
        return f"{digits}{{\\cdot}}10^{{{int(power)}}}"
    return "0" if abs(value) < 0.0005 else f"{value:.{decimals(value)}f}"


def _escaped(text: str) -> str:
    for mark in "&%$#_{}":
        text = text.replace(mark, f"\\{mark}")
    return text.replace(NONE, "--")
