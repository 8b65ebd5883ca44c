"""Fitts's law as in ISO 9241-411: end points and times put back into its equations."""

import csv
from math import isnan, log2
from pathlib import Path
from random import Random
from statistics import fmean, stdev
from typing import Any

import pytest

from cogrip.experiments.study.fitts import COLUMNS, Pointing, pointing, rows_of, throughputs
from cogrip.experiments.study.study_file import Study, read_study
from cogrip.experiments.study.table import StudyTable, write_columns

STUDY: Study = read_study({
    "name": "two", "participants": [["P01", "P02"]], "goal": {"place_m": [0.03, 0.04], "within_m": 0.005},
    "conditions": {"wide": {"goal": {"within_m": 0.01}}, "narrow": {"goal": {"within_m": 0.0025}}},
    "blocks": [{"name": "trials"}],
})  # fmt: skip


def rows(
    condition: str, within_m: float, ends: list[float | None], times_s: list[float], **more: Any
) -> list[dict[str, Any]]:
    return [
        {
            "group": 1, "seat": seat, "condition": condition, "practice": 0, "goal.within_m": within_m,
            "endpoint_m": end, "completion_s": None if end is None else time_s, **more,
        }
        for end, time_s in zip(ends, times_s, strict=True)
        for seat in (0, 1)
    ]  # fmt: skip


def found(*given: list[dict[str, Any]], study: Study = STUDY) -> list[Pointing]:
    return pointing(StudyTable(study, [], [row for each in given for row in each], [], []))


def test_numbers_of_one_condition_by_hand() -> None:
    """End points -2, 0, 2 mm have s = 2 mm: W_e = 8.266 mm, ID_e = log2(50 / 8.266 + 1) = 2.8174 bit, TP = 2.8174 / 0.8 s."""
    (each,) = found(rows("wide", 0.01, [-0.002, 0.0, 0.002, None], [0.7, 0.8, 0.9, 9.0]))
    assert (each.group, each.condition, each.trials, each.missed) == (1, "wide", 3, 1)
    assert (each.distance_m, each.width_m) == pytest.approx((0.05, 0.02))
    assert each.difficulty_bits == pytest.approx(log2(3.5))
    assert each.movement_s == pytest.approx(0.8)
    assert each.effective_width_m == pytest.approx(0.008266)
    assert each.effective_difficulty_bits == pytest.approx(2.8174, abs=5e-5)
    assert each.throughput_bitps == pytest.approx(3.5217, abs=1e-4)


def test_the_distance_is_the_one_that_was_moved() -> None:
    (each,) = found(rows("wide", 0.01, [0.004, 0.006, 0.008], [1.0] * 3))
    assert each.effective_distance_m == pytest.approx(0.056)


def test_a_group_has_the_mean_over_its_conditions() -> None:
    """And not that over trials: the second condition has twice as many."""
    draw = Random(1)
    wide = rows("wide", 0.01, [draw.gauss(0.0, 0.004) for _ in range(10)], [0.6] * 10)
    narrow = rows("narrow", 0.0025, [draw.gauss(0.0, 0.001) for _ in range(20)], [1.1] * 20)
    both = found(wide, narrow, rows("wide", 0.01, [0.1, -0.1, 0.2], [5.0] * 3, practice=1))
    assert [each.trials for each in both] == [10, 20]
    assert throughputs(both)[1].bitps == pytest.approx((both[0].throughput_bitps + both[1].throughput_bitps) / 2.0)


def test_the_error_is_that_of_many_studies_and_tells_how_many_trials_are_enough() -> None:
    draw = Random(2)

    def one(trials: int) -> list[Pointing]:
        ends = [draw.gauss(0.0, 0.004) for _ in range(trials)]
        return found(rows("wide", 0.01, list(ends), [draw.gauss(0.8, 0.1) for _ in range(trials)]))

    studies = [one(8) for _ in range(400)]
    told = [throughputs(each)[1] for each in studies]
    mean = fmean(each.bitps for each in told)
    assert stdev(each.bitps for each in told) == pytest.approx(
        fmean(each.within_bitps for each in told) / 1.96, rel=0.15
    )
    truth = log2(0.05 / (4.133 * 0.004) + 1.0) / 0.8
    assert mean == pytest.approx(truth, rel=0.05)
    enough = round(fmean(each.trials for each in told))
    assert enough > 8
    wide = [throughputs(one(enough))[1] for _ in range(100)]
    assert fmean(each.within_bitps / each.bitps for each in wide) == pytest.approx(0.1, rel=0.15)


@pytest.mark.parametrize("ends", [[], [None, None], [0.001, 0.002], [0.001] * 5])
def test_no_spread_no_throughput(ends: list[float | None], tmp_path: Path) -> None:
    """Rather none than one of a width of 0."""
    both = found(rows("wide", 0.01, [-0.002, 0.0, 0.002], [1.0] * 3), rows("narrow", 0.0025, ends, [1.0] * len(ends)))
    if ends:
        assert isnan(both[1].throughput_bitps)
    assert {group: each.bitps for group, each in throughputs(both).items()} == {1: both[0].throughput_bitps}
    write_columns(COLUMNS, rows_of(both), "csv", tmp_path / "table.csv")
    with (tmp_path / "table.csv").open(newline="") as file:
        written = list(csv.DictReader(file))
    assert float(written[0]["throughput_bitps"]) == both[0].throughput_bitps
    assert all(row["throughput_bitps"] == "" for row in written[1:])


def test_a_study_without_a_target_has_none() -> None:
    aimless = read_study({"name": "aimless", "participants": ["P01"], "blocks": [{"name": "trials"}]})
    assert found(rows("base", 0.01, [0.0, 0.001, 0.002], [1.0] * 3), study=aimless) == []
