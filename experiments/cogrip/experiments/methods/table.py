"""The results of a comparison: statistics over seeds, and the table in Markdown and as rows of text."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from cogrip.experiments.experiment import Result
from cogrip.experiments.methods.measures import (
    ACTIVE_MJ,
    ACTIVE_SHARE,
    FELT_MEASURES,
    MEASURES,
    furthest_from_0,
)
from cogrip.experiments.methods.method import METHODS
from cogrip.experiments.methods.query import FELT_SEEDS, ComparisonQuery
from cogrip.machine.addition import add_integers
from cogrip.protocol.version import VERSION
from cogrip.results.reading.summary_values import dig, is_number, lent_j, object_of
from cogrip.results.verdict.judgement import Tone

FELT = "felt_error_percent"
NONE = "–"
UNSTABLE = {"diverged": "diverged", "oscillates": "oscillates"}
NOT_PASSIVE = {"not_passive": "not passive"}
BOUNDS = (
    "Unstable: a session that diverged, or oscillates: between hands at rest, or so that a client let the force go. Not "
    "passive, stable or not: more energy came out than had gone in, by the ledger of a line or device beyond its credit, or by "
    f"more than {ACTIVE_MJ:g} mJ and {100 * ACTIVE_SHARE:g} % of what the hands had put in"
)
NOT_FELT = (
    "Not felt as intended: a stable session in which, for longer than hands should feel it, a limit of the device held the "
    "force, the device port changed it, or frames were replaced"
)


class TableColumn(NamedTuple):
    """A measure in the table: its heading and unit, its LaTeX symbol, and whether the least of it is the best."""

    measure: str
    heading: str
    unit: str
    symbol: str
    ranked: bool = True


TABLE = (
    TableColumn("created_mj", "created", "mJ", "E^{+}"),
    TableColumn("peak_force_n", "peak", "N", "F_{\\max}"),
    TableColumn("force_step_n", "step", "N", "\\Delta F"),
    TableColumn("coherence_rms_mm", "views", "mm", "\\delta_{\\mathrm{rms}}"),
    TableColumn("coherence_max_mm", "max", "mm", "\\delta_{\\max}"),
    TableColumn("rest_mm", "rest", "mm", "d"),
    TableColumn("rest_swing_n", "swing", "N", "\\Delta F_{\\mathrm{r}}"),
    TableColumn(FELT, "felt", "%", "\\epsilon_K"),
    TableColumn("error_clean_n", "to clean", "N", "e_{\\mathrm{cl}}"),
    TableColumn("error_ideal_n", "to ideal", "N", "e_{\\mathrm{id}}"),
)
SCENE_TABLE = (
    *(column for column in TABLE if column.measure != FELT),
    TableColumn("contact_n", "contact", "N", "N_{\\max}", ranked=False),
    TableColumn("slip_mm", "slip", "mm", "s"),
    TableColumn("lifted_mm", "lifted", "mm", "h", ranked=False),
    TableColumn("lifted_s", "lifted for", "s", "t_h", ranked=False),
)


def columns_of(summary: Mapping[str, Any]) -> tuple[TableColumn, ...]:
    """Return the columns of a comparison's table: a scene has no stiffness that is asked for, but slip and lift."""
    return SCENE_TABLE if object_of(dig(summary, "asked", "settings")).scene else TABLE


def gather(asked: ComparisonQuery, results: Mapping[int, Result]) -> dict[str, Any]:
    """Return `summary.json`: the query, and one row for every method on every network, over all seeds."""
    rows = []
    for network in asked.networks:
        for method in asked.methods:
            wanted = {"network": network, "method": method}
            found = [result for case, result in sorted(results.items()) if wanted.items() <= asked.values(case).items()]
            rows.append(
                {**wanted, "ours": METHODS[method].ours, "credit_mj": credit_mj(asked.base, method), **_gathered(found)}
            )
    return {
        "name": asked.base["name"],
        "sessions": asked.cases,
        "run": len(results),
        "version": VERSION,
        "measures": {name: {"unit": measure.unit, "what": measure.what} for name, measure in MEASURES.items()},
        "asked": asked.query,
        "rows": rows,
    }


def credit_mj(base: Mapping[str, Any], method: str) -> float | None:
    """Return what each direction of a person's line may lend under a method [mJ]: its energy credit."""
    lent = lent_j({**base, "coupling": {"kind": METHODS[method].overrides["coupling.kind"]}})
    return None if lent is None else round(1e3 * lent, 9)


def credits_of(summary: Mapping[str, Any], name: Callable[[str], str] = str) -> str:
    """Return the sentences on the methods' energy credits. name: what to call a method."""
    lent = {name(row["method"]): row["credit_mj"] for row in summary["rows"]}
    words = ", ".join(f"{method} {'not known' if value is None else f'{value:g} mJ'}" for method, value in lent.items())
    return (
        f"Energy credit, what each direction of a person's line may give out before as much has come in: {words}. So a method "
        "may have created more than another, and be passive, where what it created was lent, is the leak of the devices' "
        "sampled dampers, or is what the gates of models of partners give to a hand that rests (20 mW at most)."
    )


def _gathered(results: Sequence[Result]) -> dict[str, Any]:
    ran = [result.measures for result in results if not result.error]
    ends = sorted(row["diverged_s"] for row in ran if row["diverged"])
    return {
        "runs": len(ran),
        "failed": add_integers(bool(result.error) for result in results),
        "errors": dict(Counter(result.error for result in results if result.error)),
        "diverged": len(ends),
        "diverged_s": {"median": statistics.median(ends), "first": ends[0]} if ends else None,
        "reasons": dict(Counter(row["reason"].partition(" at ")[0] for row in ran if row["diverged"])),
        "oscillates": add_integers(row["oscillates"] for row in ran),
        "not_passive": add_integers(row["passive"] is False for row in ran),
        "not_felt": add_integers(bool(row["not_felt"]) for row in ran),
        "felt": _felt([row["felt"] for row in ran if row["felt"]]),
        **{name: spread([row[name] for row in ran], each.worst) for name, each in MEASURES.items() if name != FELT},
        FELT: of_probes([row[FELT] for row in ran if row["felt"]]),
    }


def spread(values: Sequence[Any], worst: Callable[[list[float]], float] = furthest_from_0) -> dict[str, float] | None:
    """Return median, quartiles and the worst; None without any number."""
    numbers = [float(value) for value in values if is_number(value)]
    if not numbers:
        return None
    first, median, third = statistics.quantiles(numbers, n=4, method="inclusive") if len(numbers) > 1 else numbers * 3
    return {"median": median, "q1": first, "q3": third, "worst": worst(numbers)}


def of_probes(values: Sequence[float | None]) -> dict[str, float] | None:
    """Return the spread of a felt stiffness, with `n` of the `of` probes that came to rest; None where none did."""
    found = spread(values)
    return found and {**found, "n": add_integers(map(is_number, values)), "of": len(values)}


def _felt(sessions: Sequence[Sequence[Mapping[str, Any]]]) -> list[dict[str, Any]]:
    """Return each person's felt stiffness over seeds; K is the same in all."""
    people = []
    for seeds in zip(*sessions, strict=True):
        found = {name: of_probes([seed[name] for seed in seeds]) for name in FELT_MEASURES}
        if stiffness := found["felt_npm"]:
            del stiffness["worst"]  # what is furthest from 0 is the best of a stiffness
        people.append({"person": seeds[0]["person"], "asked_npm": seeds[0]["asked_npm"], **found})
    return people


def feels(found: Mapping[str, float] | None) -> bool:
    """Return whether more than half of the probes came to rest; otherwise the number would speak for a few."""
    return found is not None and 2 * found["n"] > found["of"]


def unstable(row: Mapping[str, Any]) -> bool:
    """Return whether half of the runs or more diverged or oscillate."""
    return bool(row["runs"]) and 2 * (row["diverged"] + row["oscillates"]) >= row["runs"]


def tone(row: Mapping[str, Any]) -> Tone:
    """Return how a row is marked: bad if any session was unstable or not passive, warn if any was not felt as intended."""
    if row["diverged"] or row["oscillates"] or row["not_passive"]:
        return "bad"
    return "warn" if row["not_felt"] else "good"


def verdict(row: Mapping[str, Any]) -> str:
    """Return the verdict in words, first the stability: `stable`, or `diverged 20/20 (median 1.3 s), oscillates 3/20`.

    Then passivity, `not passive 3/20`; `not felt as intended 3/20` (limits, replaced frames: NOT_FELT); `not run 1`.
    """
    when = " (median {:.2g} s)" if row["diverged"] > 1 else " at {:.2g} s"
    words = judgements(row, UNSTABLE, NOT_PASSIVE, when)
    if row["not_felt"]:
        words.append(f"not felt as intended {row['not_felt']}/{row['runs']}")
    if row["failed"]:
        words.append(f"not run {row['failed']}")
    return ", ".join(words) or NONE


def judgements(
    row: Mapping[str, Any], unstable_words: Mapping[str, str], passive_words: Mapping[str, str], when: str
) -> list[str]:
    """Return `stable`, or how often it is not, and how often it is not passive, in the given words.

    when: format of the time of divergence
    """
    texts = [f"{word} {row[key]}/{row['runs']}" for key, word in unstable_words.items() if row[key]]
    if row["diverged"]:
        texts[0] += when.format(row["diverged_s"]["median"])
    if not texts and row["runs"]:
        texts.append("stable")
    return texts + [f"{word} {row[key]}/{row['runs']}" for key, word in passive_words.items() if row[key]]


def shown(row: Mapping[str, Any], column: TableColumn, worst_too: bool = True) -> str:
    """Return the median, and the worst in brackets where it differs as shown."""
    found = row[column.measure]
    if found is None or (column.measure == FELT and (unstable(row) or not feels(found))):
        return NONE
    show = _signed if column.measure == FELT else _short
    median, worst = show(found["median"]), show(found["worst"])
    return f"{median} ({worst})" if worst_too and worst != median else median


def _short(value: float) -> str:
    """Return three digits; a power of ten from 1e5 on."""
    if round(abs(value)) >= 1e5:
        digits, _, power = f"{value:.1e}".partition("e")
        return f"{digits}e{int(power)}"
    return "0" if abs(value) < 0.0005 else f"{value:.{decimals(value)}f}"


def decimals(value: float) -> int:
    """Return the digits after the point for three digits in all, counted after rounding (9.996 is 10.0)."""
    return _decimals(float(f"{value:.{_decimals(value)}f}"))


def _decimals(value: float) -> int:
    size = abs(value)
    return 0 if size >= 100.0 else 1 if size >= 10.0 else 2 if size >= 0.1 else 3


def _signed(value: float) -> str:
    text = f"{value:+.1f}"
    return "0.0" if float(text) == 0.0 else text.replace("-", "−")


def cells(row: Mapping[str, Any], worst_too: bool = True, columns: Sequence[TableColumn] = TABLE) -> list[str]:
    """Return one row's text, from the verdict on."""
    return [verdict(row), *(shown(row, column, worst_too) for column in columns)]


def headings(columns: Sequence[TableColumn] = TABLE) -> list[str]:
    """Return the headings of the table."""
    return ["profile", "method", "verdict", *(f"{column.heading} [{column.unit}]" for column in columns)]


def notes(summary: Mapping[str, Any], worst: str = "worst in brackets") -> list[str]:
    """Return the paragraphs under the table: methods, verdicts, credits, columns."""
    seeds = len(summary["asked"]["seeds"])
    own = (
        f"felt{first_seeds(seeds)}: stiffness felt under a static load against the K asked for, where more than half of the "
        "probes came to rest"
    )
    ideal = "the object directly in the hands"
    if columns_of(summary) is SCENE_TABLE:
        own = (
            "contact: largest normal force at a tool; slip: of a tool along what it touches, while the object is lifted; "
            "lifted, lifted for: how far, and for how long (the least in brackets)"
        )
        ideal = "tools on springs K and dampers B at the device rate"
    methods = ", ".join(
        f"{method} ({METHODS[method].title})" for method in dict.fromkeys(row["method"] for row in summary["rows"])
    )
    return [
        f"Methods: {methods}.",
        f"{BOUNDS}. {NOT_FELT}.",
        credits_of(summary),
        (
            f"Median over {seeds} seed{'s' if seeds > 1 else ''} ({worst}). created: energy that came out and no hand had put "
            "in, encoders included; peak, step: largest force, and largest change of it in one tick; views: distance between "
            "the object's positions as reported to two people, rms and max over time; rest: distance left between hands that "
            f"hold still at the end; swing: of a force then; {own}; to clean, to ideal: rms force difference to the same "
            f"method on a clean link, and to {ideal}. Sessions that diverged are measured up to then."
        ),
    ]


def first_seeds(seeds: int, most: int = FELT_SEEDS) -> str:
    """Return the note behind what is not of all `seeds`, such as a felt stiffness."""
    return f" (first {most} seeds)" if seeds > most else ""


def markdown(summary: Mapping[str, Any]) -> str:
    """Return the table in Markdown."""
    columns = columns_of(summary)
    lines = [_bars(headings(columns)), _bars(["---", "---", "---", *["---:"] * len(columns)])]
    lines += [_bars([row["network"], row["method"], *cells(row, columns=columns)]) for row in summary["rows"]]
    return "\n".join([*lines, "", "\n\n".join(notes(summary)), ""])


def _bars(texts: Sequence[str]) -> str:
    return f"| {' | '.join(text.replace('|', '/') for text in texts)} |"
