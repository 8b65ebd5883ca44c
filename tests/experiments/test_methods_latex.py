"""Tests of the table of a paper, parsed strictly: every row has its columns, every bracket its partner."""

import re
from typing import Any

import pytest
from matplotlib.mathtext import MathTextParser

from cogrip.experiments.methods.latex import latex
from cogrip.experiments.methods.query import FELT_SEEDS
from cogrip.experiments.methods.table import TABLE, notes

from tests.experiments.compared_methods import row_of as row

TEX = MathTextParser("path")
MEASURES = [column.measure for column in TABLE]


def of(median: float, q1: float | None = None, q3: float | None = None, n: int = 5) -> dict[str, float]:
    """Return the statistics of a felt stiffness of n probes of five."""
    first, third = median if q1 is None else q1, median if q3 is None else q3
    return {"median": median, "q1": first, "q3": third, "worst": median, "n": n, "of": 5}


def table(*rows: dict[str, Any], seeds: int = 20) -> str:
    asked = {"seeds": list(range(seeds)), "settings": {"users": [{}, {}], "seconds": 10.0}}
    return latex({"rows": list(rows), "asked": asked})


def parse(text: str) -> list[list[str]]:
    """Return the rows of cells of the one tabular, after checks of its syntax."""
    environments: list[str] = []
    for word, name in re.findall(r"\\(begin|end)\{([a-z*]+)\}", text):
        if word == "begin":
            environments.append(name)
        else:
            assert environments.pop() == name
    assert environments == []
    for opening, closing in ("{}", "()"):
        assert text.count(opening) == text.count(closing)
    assert text.isascii()
    body = re.search(r"\\begin\{tabular\}\{@\{\}([lrc]+)@\{\}\}\n(.*)\n\\end\{tabular\}", text, re.DOTALL)
    rows = []
    for line in body[2].splitlines():
        if line in ("\\toprule", "\\midrule", "\\bottomrule"):
            continue
        assert line.endswith(" \\\\")
        cases = re.split(r"(?<!\\)&", line.removesuffix("\\\\"))
        assert len(cases) == len(body[1])
        rows.append([case.strip() for case in cases])
        for case in cases:
            assert case.count("$") % 2 == 0
            for mathematics in case.split("$")[1::2]:
                TEX.parse(f"${mathematics}$")  # which refuses a second index, or exponent, of a symbol
            assert not re.search(r"(?<!\\)[%#]", case)
            if "$" not in case:
                assert not re.search(r"(?<!\\)[_^]", case)
    return rows


def case(text: str, line: int, measure: str) -> str:
    return parse(text)[2 + line][3 + MEASURES.index(measure)]


def test_a_head_of_symbols_a_row_of_units_and_a_row_each() -> None:
    text = table(*(row(network, method) for network in ("clean", "wan") for method in ("wave", "tdpa")))
    symbols, units, *rows = parse(text)
    assert symbols[:3] == ["Network", "Method", "Verdict"]
    assert all(case.startswith("$") for case in symbols[3:])
    assert units[3:] == [f"({column.unit})".replace("%", "\\%") for column in TABLE]
    assert [(cases[0], cases[2]) for cases in rows] == [
        ("clean", "stable"), ("", "stable"), ("wan", "stable"), ("", "stable"),
    ]  # fmt: skip
    assert text.count("\\midrule") == 2
    assert "\\label{tab:methods}" in text
    assert text.index("\\caption") < text.index("\\begin{tabular}")
    for column in TABLE:
        assert f"${column.symbol}$:" in text  # the caption says what each is


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (of(1.234), "$1.23$"),
        (of(1.234, 1.2341, 1.2339), "$1.23$"),
        (of(1.234, 1.1, 1.3), "$1.23_{1.10}^{1.30}$"),
        (of(0.01234, 0.0, 12.34), "$0.012_{0}^{12.3}$"),
        (of(123.4), "$123$"),
        (of(3.3e7, 1e7, 1.3e8), "$3.3{\\cdot}10^{7}$"),
        (of(0.5, 0.1, 3e4), "$0.50$"),
        (of(9.994), "$9.99$"),
        (of(9.996), "$10.0$"),  # as 10.0 is
        (of(99.96), "$100$"),
        (of(0.0996), "$0.10$"),
        (of(9999.4), "$9999$"),
        (of(9999.6), "$1.0{\\cdot}10^{4}$"),
        (None, "--"),
    ],
)
def test_numbers_as_they_are_printed(value: Any, text: str) -> None:
    assert case(table(row("wan", "wave", created_mj=value)), 0, "created_mj") == text


def test_the_best_of_each_network_is_bold() -> None:
    text = table(
        row("lan", "wave", peak_force_n=of(2.0), felt_error_percent=of(-20.0)),
        row("lan", "coupling", peak_force_n=of(1.5), felt_error_percent=of(1.0), oscillates=20),
        row("lan", "tdpa", peak_force_n=of(3.0), felt_error_percent=of(-60.0)),
        row("wan", "wave", peak_force_n=of(2.0001)),
        row("wan", "tdpa", peak_force_n=of(2.0)),
        row("wan", "paper", peak_force_n=of(9.0)),
    )
    peaks = [case(text, line, "peak_force_n") for line in range(6)]
    assert peaks == ["$\\mathbf{2.00}$", "$1.50$", "$3.00$", "$\\mathbf{2.00}$", "$\\mathbf{2.00}$", "$9.00$"]
    felt = [case(text, line, "felt_error_percent") for line in range(3)]
    assert felt == ["$\\mathbf{-20.0}$", "--", "$-60.0$"]
    assert "mathbf" not in case(text, 0, "force_step_n")  # all are equal
    alone = table(row("wan", "wave"), row("wan", "paper", oscillates=20))
    assert "mathbf" not in alone  # nothing to hold it against
    pair = [row("wan", "wave", peak_force_n=of(2.0)), row("wan", "tdpa", peak_force_n=of(3.0))]
    for changes, best in (({"oscillates": 9}, 2), ({"oscillates": 10}, 0), ({"not_passive": 20}, 2)):
        other = row("wan", "coupling", peak_force_n=of(1.0), **changes)
        assert "mathbf" in case(table(*pair, other), best, "peak_force_n")


def test_what_prints_alike_is_bold_alike_whatever_its_sign() -> None:
    """The least in absolute value is."""
    text = table(
        row("wan", "wave", felt_error_percent=of(-20.01), peak_force_n=of(9.996)),
        row("wan", "tdpa", felt_error_percent=of(20.0), peak_force_n=of(10.0)),
        row("wan", "coupling", felt_error_percent=of(-30.0), peak_force_n=of(11.0)),
    )
    for measure in ("felt_error_percent", "peak_force_n"):
        assert ["mathbf" in case(text, line, measure) for line in range(3)] == [True, True, False]


@pytest.mark.parametrize(("rested", "shown"), [(2, False), (3, True), (5, True)])
def test_a_felt_stiffness_is_that_of_more_than_half_of_the_probes(rested: int, shown: bool) -> None:
    text = table(
        row("wan", "wave", felt_error_percent=of(-20.0, n=rested)), row("wan", "tdpa", felt_error_percent=of(-30.0))
    )
    assert (case(text, 0, "felt_error_percent") != "--") == shown
    assert ("mathbf" in case(text, 0, "felt_error_percent")) == shown
    assert "or at least half of the probes never came to rest" in text


@pytest.mark.parametrize(("seeds", "said"), [(FELT_SEEDS, False), (FELT_SEEDS + 1, True)])
def test_the_caption_says_with_how_many_seeds_a_stiffness_was_felt(seeds: int, said: bool) -> None:
    text = table(row("wan", "wave"), seeds=seeds)
    assert (f"with the largest (first {FELT_SEEDS} seeds);" in text) == said
    assert ("first" in " ".join(notes({"asked": {"seeds": range(seeds)}, "rows": [row()]}))) == said


def test_the_clean_link_is_not_held_against_itself() -> None:
    rows = [row(network, method, error_clean_n=of(error)) for network in ("clean", "wan")
            for method, error in (("wave", 0.0), ("tdpa", 0.1))]  # fmt: skip
    text = table(*rows)
    assert [("mathbf" in case(text, line, "error_clean_n")) for line in range(4)] == [False, False, True, False]


@pytest.mark.parametrize(("diverged", "hidden"), [(9, False), (10, True)])
def test_what_was_cut_short_has_no_numbers_but_what_it_created(diverged: int, hidden: bool) -> None:
    text = table(row("wan", "paper", diverged=diverged, diverged_s={"median": 0.291, "first": 0.2}))
    assert parse(text)[2][2] == f"div. {diverged}/20 (0.29~s)"
    for measure in MEASURES:
        shown = case(text, 0, measure)
        assert (shown == "--") == (hidden and measure != "created_mj")


def test_verdicts_in_short() -> None:
    both = {"diverged": 1, "diverged_s": {"median": 7.4, "first": 7.4}, "oscillates": 17, "not_passive": 2, "failed": 2}
    rows = parse(table(row("lan", "coupling", **both), row("lan", "wave", runs=0)))[2:]
    assert [cases[2] for cases in rows] == ["div. 1/20 (7.4~s), osc. 17/20, n.p. 2/20, not run 2", "--"]
    assert parse(table(row("clean", "coupling", not_passive=20)))[2][2] == "stable, n.p. 20/20"
    assert "One seed." in table(row("lan", "wave"), seeds=1)
