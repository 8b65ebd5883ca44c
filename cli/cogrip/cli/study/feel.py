"""`cogrip feel`: the impedance that one person's hand will feel, from the lifted model."""

from pathlib import Path

import numpy as np
from rich.table import Table

from cogrip.analysis.advice.delay_budget import budget, total_s
from cogrip.analysis.advice.free_end import free_end, free_end_record, free_end_text
from cogrip.analysis.feel.feel import conditions
from cogrip.analysis.linear.linear_session import LinearSession
from cogrip.cli.study.analysis_query import AS_IT_STANDS, ModelQuery
from cogrip.cli.study.partner_room import tell_partners
from cogrip.cli.terminal.output import make_console, write_json
from cogrip.cli.terminal.parameters import Config
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.tables import say


def feel(config: Config, /, *, user: int = 0, query: ModelQuery = AS_IT_STANDS, out: Path | None = None) -> int:
    """Print felt stiffness, damping and inertia at low frequency, and the delay budget; with --out the impedance to 64 Hz.

    In free motion without contact, alone with the object, on a wall, and with everybody else holding on (300 N/m, 5 N s/m).
    With models of partners: the stiffness felt at rest and the loop gain, for hands of several stiffnesses.

    Parameters
    ----------
    user
        Whose hand: the user's number.
    out
        Folder for feel.png, .svg and .csv: rendered and ideal impedance over frequency.
    """
    if out is None and user == 0 and (settings := query.settings(config)).coupling.traits.gated:  # all feel the same
        return tell_partners(settings, query.json, str(config))
    session = query.model(config).session
    if not 0 <= user < len(session.people):
        raise BadInput(f"--user {user}: users are numbered 0 to {len(session.people) - 1}")
    if query.json:
        write_json(_record(session, user), query.json)
    else:
        _tell(session, user)
    if out is not None:
        from cogrip.analysis.figures.feel import feel_page
        from cogrip.analysis.figures.page import save_page

        with Problem.of(OSError, where=f"--out {out}: cannot be written: "):
            paths = save_page(out, feel_page(session, user))
        make_console(stderr=True, soft_wrap=True).print("written: " + ", ".join(map(str, paths)))
    return 0


def _tell(session: LinearSession, user: int) -> None:
    console = make_console()
    table = Table(title=f"what {session.people[user].name} feels, the device apart")
    for column in ("", "stiffness (N/m)", "damping (N s/m)", "inertia (kg)"):
        table.add_column(column, justify="right")
    for condition in conditions(session, user, np.array([1.0])):
        slow = condition.slow
        table.add_row(condition.name, _number(slow.stiffness_npm), _number(slow.damping_nspm), _number(slow.inertia_kg))
    console.print(table)
    if found := free_end(session, user):
        say(console, free_end_text(found, session.frame_s))
    stages = budget(session, user)
    delays = Table(title=f"from the hand to its answer: {1e3 * total_s(stages):.1f} ms")
    for column in ("direction", "stage", "ms", ""):
        delays.add_column(column)
    for stage in stages:
        delays.add_row(stage.direction, stage.name, f"{1e3 * stage.delay_s:.2f}", stage.why)
    console.print(delays)


def _number(value: float) -> str:
    return "0" if abs(value) < 1e-6 else f"{value:.4g}"


def _record(session: LinearSession, user: int) -> dict[str, object]:
    found = {}
    for condition in conditions(session, user, np.array([1.0])):
        slow = condition.slow
        found[condition.name] = {
            "stiffness_npm": slow.stiffness_npm, "damping_nspm": slow.damping_nspm, "inertia_kg": slow.inertia_kg,
        }  # fmt: skip
    stages, free = budget(session, user), free_end(session, user)
    return {
        "user": session.people[user].name,
        "conditions": found,
        "free_end": None if free is None else free_end_record(free),
        "delay_ms": {f"{stage.direction} {stage.name}": 1e3 * stage.delay_s for stage in stages},
        "delay_total_ms": 1e3 * total_s(stages),
    }
