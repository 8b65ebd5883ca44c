"""Ways through gaps on the storm of `dev.py bench concealment`, shorter: the same assertions, and both sides of them."""

import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Playout

from tests.bench.concealment import MOST_DRIFT_MM, MOST_PEAK, NOTHING_J, shortfalls
from tests.bench.concealment_trial import CLEAN, ROWS, Setup, Trial, drifts_mm, moments, table, try_out
from tests.extent import long

MOMENT, LEAKING = Setup(seconds=6.0, seed=4), Setup(seconds=12.0, seed=12)  # their first outage tells ways apart
HALF_A_MINUTE = long(Setup(seconds=30.0))
CONFIG = Path(__file__).parents[2] / "configs" / "storm.toml"


trial_of = cache(try_out)


def trials(setup: Setup) -> dict[str, Trial]:
    return {name: trial_of(setup, name) for name in ROWS}


@pytest.mark.sample(2)
@pytest.mark.parametrize("setup", [MOMENT, HALF_A_MINUTE])
@pytest.mark.parametrize("name", ROWS)
def test_no_way_through_gaps_makes_energy(name: str, setup: Setup) -> None:
    trial = trial_of(setup, name)
    assert trial.diverged == ""
    assert trial.lent_j == (
        0.0 if name in ("zero", "repaid") else 2e-3 * (Playout().tank_mj if name == CLEAN else setup.tank_mj)
    )
    assert trial.least_margin_j >= -trial.lent_j + NOTHING_J


@pytest.mark.parametrize("setup", [MOMENT, HALF_A_MINUTE])
def test_the_best_is_lowest_in_every_row_and_the_others_fail_where_they_should(setup: Setup) -> None:
    rows = trials(setup)
    best, zero = rows["elastic"], rows["zero"]
    assert shortfalls(rows) == []
    assert best.peak_n <= MOST_PEAK * zero.peak_n
    for key in ("peak_n", "step_n", "law_peak_n", "law_step_n"):
        assert all(getattr(best, key) < getattr(rows[name], key) for name in ("zero", "repaid", "tank"))
        assert getattr(rows[CLEAN], key) <= getattr(best, key)
    assert best.law_step_n < 0.5 * zero.law_step_n
    assert best.step_n < 0.41  # safety lets a gap change the force by 0.4 N a tick
    assert max(drifts_mm(best, rows[CLEAN])) < MOST_DRIFT_MM
    assert max(drifts_mm(zero, rows[CLEAN])) > 10.0


@pytest.mark.long
@pytest.mark.parametrize("setup", [LEAKING, HALF_A_MINUTE])
def test_the_device_end_gives_less(setup: Setup) -> None:
    elastic, zero = (trial_of(setup, name).least_leak_j for name in ("elastic", "zero"))
    assert 3.0 * elastic > zero, "the device end gives less than a third"


@pytest.mark.parametrize("setup", [MOMENT, HALF_A_MINUTE])
def test_it_was_a_storm(setup: Setup) -> None:
    rows = trials(setup)
    for name in ROWS[1:]:
        assert rows[name].missing > 0.2
        assert rows[name].longest_gap >= 50
    assert rows[CLEAN].missing == 0.0


def test_every_recovery_is_judged_once_with_hands_at_rest() -> None:
    frames = moments(600.0, 128)
    assert len(frames) == 199
    for k in frames:
        assert k / 128 % 3.0 >= 0.5
        assert k / 128 % 2.45 + 1e-9 >= 1.8
    assert sorted({int(k / 128 // 3.0) for k in frames}) == list(range(1, 200))


def test_a_shortfall_is_named() -> None:
    rows = trials(MOMENT)
    worse = {**rows, "elastic": replace(rows["zero"], name="elastic", least_margin_j=-1e-3, lent_j=9e-4)}
    found = " / ".join(shortfalls(worse))
    assert "above 0.75 of zero-fill's" in found
    assert "is not below 1 mm" in found
    assert "step_n of elastic is not below that of zero" in found
    assert "a margin of -1.0e-03 J is below that of the credit, -9.0e-04 J" in found
    assert "a margin" not in " / ".join(shortfalls({**worse, "elastic": replace(worse["elastic"], lent_j=1e-3)}))


@pytest.mark.parametrize("name", ROWS)
def test_rows_differ_in_what_they_are_about_alone(name: str) -> None:
    settings, zero = resolve(table(MOMENT, name)), resolve(table(MOMENT, "zero"))
    assert settings.users == zero.users
    assert settings.object == zero.object
    assert (settings.link == zero.link) is (name != CLEAN)
    assert (settings.playout.tank_mj > 0.0) is (name in (CLEAN, "tank", "elastic"))


def test_the_config_is_the_storm() -> None:
    config = resolve(tomllib.loads(CONFIG.read_text()))
    assert config == resolve(table(Setup(), "elastic"))
