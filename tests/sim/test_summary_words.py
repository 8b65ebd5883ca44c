"""Words on a summary: the verdict in sentences, the table in the terminal, numbers with units."""

import json
import math
import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cogrip.protocol.accounts import ClientAccount, DeviceAccount, LinkCount, Percentiles, SeatAccount, TickCount
from cogrip.protocol.settings import resolve
from cogrip.sim.runs.folder import summary_text
from cogrip.sim.runs.laboratory_run import run_laboratory
from cogrip.sim.runs.listing import list_runs
from cogrip.sim.runs.summary import UserRecord, summarise
from cogrip.sim.runs.summary_values import energy, number, share
from cogrip.sim.runs.traces import load_run
from cogrip.sim.runs.verdict import succeeded
from cogrip.sim.runs.verdict_text import MANY_LATE, verdict

from tests.sim.reported_runs import printed


def words(summary: dict[str, Any]) -> str:
    return " ".join(sentence for _, sentence in verdict(summary))


@pytest.mark.parametrize("summary", [{}, {"users": None}, {"users": [None, 3, {}]}, {"server": 7, "object": []}])
def test_strange_summaries_print(summary: dict[str, Any]) -> None:
    assert printed(summary)


def test_verdict_names_who_broke_passivity_and_by_how_much(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    assert "Passive" in words(summary)
    assert "nothing diverged" in words(summary)
    summary["passive"] = False
    summary["users"][1]["energy"]["down_margin_j"] = -0.0034
    assert "Not passive: the line down of ben gave out 3.4 mJ more than had been put in." in words(summary)


def test_verdict_says_why_it_diverged(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    summary["diverged"] = True
    assert "The object left the workspace" in words(summary)
    summary["users"][0]["reason"] = "force at its limit"
    assert "Diverged. anna: force at its limit." in words(summary)


def test_verdict_counts_ticks(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    assert "Every loop ran every tick." in words(summary)
    summary["users"][0]["ticks"] = {"due": 1000, "run": 990, "late_us": {"p99": 312.4}}
    assert "anna 99.00 %" in words(summary)
    assert "within 312 µs" in words(summary)


@pytest.mark.parametrize("width", [80, 100])
def test_terminal_table_fits(finished: Path, width: int) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    for user in summary["users"]:
        user["position_m"] = [0.0123, -0.0123, 0.0]
        user["ticks"]["late_us"]["p99"] = 1234.5
    lines = printed(summary, width).splitlines()
    assert max(map(len, lines)) <= width
    if width == 100:
        table = "\n".join(lines[: 4 + len(summary["users"])])
        assert "…" not in table
        assert "12.3 −12.3 0.0" in table


@pytest.mark.parametrize(
    ("value_j", "text"),
    [
        (None, "not known"),
        (math.nan, "nan"),
        (0.0, "0 J"),
        (-3e-22, "0 J"),
        (-0.0034, "−3.4 mJ"),
        (12.0, "12 J"),
        (2.5e-8, "25 nJ"),
    ],
)
def test_energy_takes_the_unit_that_fits(value_j: float | None, text: str) -> None:
    assert energy(value_j) == text


def test_numbers_do_not_lie_by_rounding() -> None:
    assert share(0.999999) == "99.99 %"
    assert share(1.0) == "100 %"
    assert number(-0.0001) == "0.0"
    assert number(True) == "True"


def too_late(late: int, sent: int, frames: Any = 1, **changes: Any) -> list[str]:
    """Return the sentences where so many frames up came too late, and hardly any down."""
    link = {"up": {"late": late, "sent": sent}, "down": {"late": 1, "sent": sent}}
    user = {
        "name": "anna",
        "link": link,
        "playout": {"up": {"depth_frames": 1.0}, "down": {"depth_frames": 1.0}},
        **changes,
    }
    return [text for tone, text in verdict({"users": [user], "playout_frames": frames}) if "too late" in text]


@pytest.mark.parametrize(
    ("late", "sent", "said"),
    [
        (MANY_LATE, 400, True),
        (MANY_LATE, 401, False),  # less than a share of 0.05
        (MANY_LATE - 1, 100, False),  # too few to say
        (310, 1000, True),
    ],
)
def test_a_depth_that_is_too_shallow_is_said_with_its_cure(late: int, sent: int, said: bool) -> None:
    assert len(too_late(late, sent)) == said
    if said:
        [text] = too_late(late, sent)
        assert text.startswith(
            f"{100 * late / sent:.0f} % of the frames from anna came too late for playout.frames = 1 "
        )
        assert '"auto" follows the network' in text


def test_nothing_is_said_of_a_depth_that_follows_or_of_what_is_not_played_out() -> None:
    assert too_late(310, 1000, "auto") == []
    assert too_late(310, 1000, None) == []
    assert too_late(310, 1000, playout={"up": None, "down": None}) == []
    assert too_late(310, 1000, link={"up": None, "down": None}) == []
    earlier = {"name": "anna", "link": {"up": {"late": 500, "sent": 1000}}, "playout": {"up": {"depth_frames": 1.0}}}
    [text] = too_late(310, 1000, earlier=[earlier])
    assert text.startswith("50 % of the frames from anna (and 5 % or more in 1 of the other directions)")


def test_a_session_with_a_fixed_depth_says_so_and_one_that_follows_does_not() -> None:
    table = {"seconds": 2.0, "link": {"delay_ms": 20.0, "jitter_ms": 20.0}, "users": [{"name": "anna"}]}
    for frames, warns in ((0, True), ("auto", False)):
        summary = run_laboratory(resolve({**table, "playout": {"frames": frames}})).summary
        assert summary["playout_frames"] == frames
        assert any("came too late for playout.frames" in text for _, text in verdict(summary)) is warns


# What an end may say of itself: an account holds any float that there is ------------------------------------------------


def said(client_margin_j: float, seat_margin_j: float, other: float = 0.0) -> dict[str, Any]:
    """Return the summary of a run of which the ends say this; `other` stands for all other numbers."""
    some = Percentiles(other, other, other, other)
    client = ClientAccount(
        (other,), (other,), other, other, other, other, client_margin_j, other, LinkCount(), some,
        TickCount(1, 1, some, some), False, "live", "", device=DeviceAccount(margin_j=0.0),
    )  # fmt: skip
    seat = SeatAccount((other,), seat_margin_j, seat_margin_j, LinkCount())
    return summarise(
        name="lab", seed=1, seconds=1.0, tank_mj=1.0, users=[UserRecord("anna", client, seat)], room=None, dropped={}
    )


@pytest.mark.parametrize(
    ("margin_j", "passive"), [(-1e-3, True), (-1.01e-3, False), (0.0, True), (math.nan, False), (-math.inf, False)]
)
def test_a_margin_that_is_no_number_is_not_passive(margin_j: float, passive: bool) -> None:
    assert said(margin_j, 0.0)["passive"] is passive
    assert said(0.0, margin_j)["passive"] is passive
    assert json.loads(summary_text(said(margin_j, 0.0)))["passive"] is passive, "null in the file is no excuse"


@pytest.mark.parametrize("strange", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_null_in_the_file(strange: float) -> None:
    summary = said(strange, 0.0, strange)
    written = json.loads(summary_text(summary), parse_constant=pytest.fail)
    [user] = written["users"]
    assert (user["position_m"], user["peak_force_n"], user["energy"]["down_margin_j"]) == ([None], None, None)
    assert (user["energy"]["up_margin_j"], user["ticks"]["late_us"]["p99"]) == (0.0, None)
    assert printed(summary)
    assert printed(written)
    assert summary_text(written) == summary_text(summary)


def test_what_is_finite_is_written_as_it_is() -> None:
    summary = said(0.1, 0.2, 0.3)
    assert json.loads(summary_text(summary)) == msgspec.json.decode(msgspec.json.encode(summary))


CONTROLS = "\x1b[31m\x9b\x07\r\n\u202e\u2028\x00"


def test_texts_of_a_run_folder_that_somebody_else_wrote_are_shown_clean(finished: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(finished, tmp_path / "run"))
    path = folder / "summary.json"
    summary = json.loads(path.read_text())
    summary["name"] = summary["users"][0]["name"] = f"anna{CONTROLS}"
    summary["users"][0] |= {"state": f"fault{CONTROLS}", "reason": f"why{CONTROLS}"}
    table = printed(summary)
    path.write_text(json.dumps({**summary, "diverged": True}))
    (listed,) = list_runs(folder, lambda _: False)
    run = load_run(folder)
    for text in (table.replace("\n", ""), listed.verdict, "".join(listed.people), "".join(run.names)):
        assert text.isprintable()
    assert "why" in listed.verdict


def test_what_only_a_client_of_others_says_decides_no_verdict(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    ben = summary["users"][1]
    ben["claimed"] = {"diverged": True, "down_margin_j": -0.0034}
    ben["energy"]["down_margin_j"] = -0.0034
    assert verdict(summary)[0][0] == verdict(summary)[1][0] == "warn"
    assert succeeded(summary), "it is the client's word"
    assert "but the client of ben says that its line down gave out 3.4 mJ too much." in words(summary)
    assert "clients say that they were not: the hand of ben." in words(summary)
    summary["passive"] = False
    ben["energy"]["up_margin_j"] = -0.001
    assert "Not passive: the line up of ben gave out 1 mJ more than had been put in." in words(summary)
