"""Conclusions of the doctor from its measurements; measuring itself is a benchmark and is only run, not judged."""

import dataclasses

import pytest

from cogrip.machine import punctuality
from cogrip.machine.punctuality import ALL, PLAIN, MachineState, Punctuality, advise


def found(p99_us, skipped=0, rate_hz=1024, setup=ALL, refused=None):
    return Punctuality(rate_hz, setup, 1000, skipped, {"p99": p99_us}, {}, refused or {})


@pytest.mark.parametrize(
    ("p99_us", "skipped", "word"),
    [
        (244.0, 1, "in reach"), (245.0, 1, "marginal"), (244.0, 2, "marginal"), (976.0, 10, "marginal"),
        (977.0, 0, "out of reach"), (10.0, 11, "out of reach"),
    ],
)  # fmt: skip
def test_verdict_on_both_sides_of_each_bound(p99_us, skipped, word):
    assert found(p99_us, skipped).verdict == word


def test_advice_names_the_cure():
    machine = quiet(usable_cpus=1, governor="powersave", virtual=True, preemption="PREEMPT_DYNAMIC", load_1min=9.0)
    refused = {"fifo": "refused: priority 40 needs an rtprio limit"}
    advice = "\n".join(advise(machine, [found(2000.0, refused=refused), found(2000.0, setup=PLAIN)]))
    for words in [
        "rtprio 40",
        "out of reach",
        "Only one processor",
        "cpupower",
        "virtual machine",
        "PREEMPT_RT",
        "busy",
    ]:
        assert words in advice


def test_a_row_is_measured_in_a_child_process():
    row = punctuality.measure(1024, ALL, 0.05)
    assert row.due >= 50
    assert set(row.lateness_us) == {"p50", "p99", "p999", "max"}


def quiet(**changed: object) -> MachineState:
    whole = {"usable_cpus": 2, "load_1min": 0.1, "virtual": False, "governor": None, **changed}
    return dataclasses.replace(punctuality.examine(), **whole)


@pytest.mark.parametrize("loads", [{"load_1min": 3.0}, {"load_after": 3.0}])
def test_under_load_no_rate_is_judged_for_good(loads):
    machine = quiet(**loads)
    advice = advise(machine, [found(2000.0)])
    assert machine.busy == 3.0
    (line,) = [line for line in advice if "1024 Hz was out of reach" in line]
    assert "measured under load (load average 3.0)" in line
    assert not any("choose a lower device rate" in line for line in advice), "not both that and: measure again"
    assert "measure again when it is quiet" in advice[-1]
    measured = quiet(load_after=1.9)
    assert measured.busy is None, "the load of the measuring itself is no load"
    assert not any("load" in line for line in advise(measured, [found(10.0)]))


def test_no_rate_is_better_in_reach_than_a_slower_one():
    slow, fast = found(2000.0), dataclasses.replace(found(10.0), rate_hz=4096)
    words = punctuality.verdicts([fast, slow])
    assert words == {1024: "out of reach", 4096: "out of reach"}
    assert any("4096 Hz is out of reach, as a slower rate is" in line for line in advise(quiet(), [slow, fast]))
