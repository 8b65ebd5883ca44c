"""Tests of the verdict on a session of a comparison: of what energy it is not passive, stable or not."""

import numpy as np
import pytest

from cogrip.analysis.feel.trace import SessionTrace
from cogrip.experiments.methods.measures import read, state_of


def test_a_session_is_not_passive_by_the_energy_that_no_ledger_accounts_for() -> None:
    """Give out eleven of a hundred mJ put in, with a devices' leak, a line's loan or a refill as large as that, and less."""
    work = np.array([0.0, 0.100, 0.100])
    for people, leaks, line, refilled, active in (
        (2, (-0.006, -0.006), 0.0, 0.0, False),
        (2, (0.5, -0.006), 0.0, 0.0, False),
        (2, (0.5, 0.5), 0.0, 0.0, True),
        (2, (0.5, 0.5), -0.001, 0.0, False),
        (2, (0.5, 0.5), 0.0, 0.0009, True),
        (2, (0.5, 0.5), 0.0, 0.0011, False),
        (1, (0.0,), None, 0.0, True),
    ):
        nothing = np.zeros((3, people, 1))
        trace = SessionTrace(
            0.5, nothing, nothing, nothing, np.zeros((3, 1)), work, np.array([0.0, 0.1, 0.111]), True, refilled
        )
        session = {
            "seconds": 1.5, "passive": True,
            "users": [
                {
                    "peak_force_n": 0.0, "peak_force_step_n": 0.0, "link": {"lost": 0, "late": 0},
                    "energy": {"device_leak_j": leak, "up_margin_j": 0.0, "down_margin_j": 0.0, "line_margin_j": line},
                }
                for leak in leaks
            ],
        }  # fmt: skip
        found = read(trace, session, "", nothing, None)
        assert found["created_mj"] == pytest.approx(11.0)
        assert found["leak_mj"] == pytest.approx(-1e3 * sum(min(0.0, leak) for leak in leaks))
        assert found["passive"] == (not active)
        assert state_of(found) == ("not_passive" if active else "passive"), "and stable"
        assert read(trace, {**session, "passive": False}, "", nothing, None)["passive"] is False, (
            "as the run was judged"
        )
        assert read(trace, {**session, "passive": None}, "", nothing, None)["passive"] is (False if active else None)
        pair = [found[name] for name in ("coherence_rms_mm", "coherence_max_mm", "hands_rms_mm", "rest_mm")]
        assert pair == [0.0 if people > 1 else None] * 4  # one alone is apart from nobody
        assert found["rest_swing_n"] == 0.0
