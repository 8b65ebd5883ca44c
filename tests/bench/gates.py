"""`dev.py bench gates`: the law of the gates of partners' models, in random sessions in which some people lie."""

from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput

from tests.sim.gate_sessions import POWER_W, outcome_of


def bench_gates(*, sessions: int = 1000, seed: int = 0, seconds: float = 2.0) -> int:
    """Run random sessions of 2 to 5 people over losses to 20 % and delays to 600 ms, and sum what all hands took out.

    Exit code 0 if in none of them the honest hands together took more than their budgets, what the power of the liars' seats
    let pass, and the take of two ticks.

    Parameters
    ----------
    sessions
        How many.
    seed
        Of the first; each has the next one.
    seconds
        Virtual time of each.
    """
    if sessions < 1:
        raise BadInput(f"--sessions {sessions}: give 1 or more")
    found = [outcome_of(seed + number, seconds) for number in range(sessions)]
    console = make_console()
    for name, some in (("all honest", False), ("with liars", True)):
        of_these = [each for each in found if bool(each.liars) is some]
        if not of_these:
            continue
        most = max(of_these, key=lambda each: each.taken_j - each.budget_j)
        spare = min(of_these, key=lambda each: each.spare_j)
        console.print(
            f"{len(of_these)} sessions {name}: the largest sum against its budget is {1e3 * most.taken_j:.2f} mJ of "
            f"{1e3 * most.budget_j:.2f} mJ (seed {most.seed}, {most.people} people, {most.liars} of them liars); "
            f"least that the law left: {1e3 * spare.spare_j:.3f} mJ (seed {spare.seed})",
            highlight=False, soft_wrap=True,
        )  # fmt: skip
    told, passed = sum(each.said_j for each in found), max(each.passed_j / max(1, each.liars) for each in found)
    console.print(
        f"liars said that they gave {told:.3g} J; of one the server passed {passed:.3f} J at most, by its seat's {POWER_W:g} W",
        highlight=False, soft_wrap=True,
    )  # fmt: skip
    broken = [each.seed for each in found if each.spare_j < -1e-9]
    if broken:
        console.print(f"the law is broken in {len(broken)}: seeds {', '.join(map(str, broken[:20]))}", highlight=False)
    return 1 if broken else 0
