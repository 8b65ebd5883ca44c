"""The numbers of docs/theory.md, put back into the code."""

import re

import pytest

from cogrip.analysis.linear.decimation_passivity import filter_of, largest_gain
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import form_overrides, linear_session
from cogrip.analysis.linear.stability import verdict
from cogrip.protocol.laws.decimation import lag_s
from cogrip.protocol.laws.felt_stiffness import felt_stiffness, line_compliance
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.room import resolve

from tests.docs.pages import page, table

THEORY = page("docs/theory.md")
FRAME_S = 1.0 / 128.0
STIFFNESSES_NPM = (100.0, 500.0, 1000.0, 2000.0, 5000.0, 10000.0, 20000.0)


def numbers(cell: str) -> list[float]:
    return [float(found) for found in re.findall(r"\d+(?:\.\d+)?", cell)]


def test_largest_gains_of_section_3_2() -> None:
    rows = table(THEORY, "`coupling.decimator`")
    assert len(rows) == 6
    for decimator, _, gain in rows:
        cutoff = 1.0
        for factor in [3.141592653589793 if "pi" in decimator else 1.0, *numbers(decimator.partition(" rad/s")[0])]:
            cutoff *= factor
        kind = decimator.split("`")[1]
        found, _ = largest_gain(filter_of(kind, Rates(1024, 128), cutoff if kind == "lowpass" else 50.0), 8)
        assert round(found, len(gain.partition(".")[2])) == float(gain), decimator


def test_felt_stiffness_of_section_4() -> None:
    for case, felt_npm in table(THEORY, "b = 20, K = 1000 N/m, boxcar"):
        (frames,) = numbers(case)
        found = felt_stiffness(1000.0, line_compliance(20.0, 2.0 * frames * FRAME_S, FRAME_S))
        assert found == pytest.approx(float(felt_npm), abs=0.6)
    assert f"{1e3 * lag_s('lowpass', FRAME_S, 50.0):.3f} ms" in THEORY


@pytest.mark.parametrize("row", table(THEORY, "scheme"), ids=lambda row: f"{row[0]}-{row[1]}")
def test_eigenvalues_of_section_6(row: list[str]) -> None:
    scheme, delay, *radii = row
    users = [{"name": "a"}, {"name": "b"}]
    for stiffness_npm, radius in zip(STIFFNESSES_NPM, radii, strict=True):
        if radius == "-":
            continue
        overrides = {**form_overrides(scheme), "coupling.stiffness_npm": stiffness_npm}  # type: ignore[arg-type]
        session = linear_session(resolve({"users": users}, overrides), delay_frames=int(delay), estimated=False)
        assert f"{verdict(LiftedModel(session)).spectral_radius:.4f}" == radius, stiffness_npm


def test_free_masses_of_section_7_1() -> None:
    for case, felt_kg in table(THEORY, "m = 0.05 kg, b = 20"):
        (frames,) = numbers(case)
        assert f"{0.05 + 20.0 * (2.0 * frames + 1.0) * FRAME_S / 2.0:.3f}" == felt_kg
