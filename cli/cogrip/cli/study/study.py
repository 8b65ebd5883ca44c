"""`cogrip study`: trials with participants, live or in virtual time; resumable."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.session.trigger_line import try_trigger
from cogrip.cli.session.view_child import is_web
from cogrip.cli.settings.before_run import AllowUnstable
from cogrip.cli.study.study_source import STUDIES, load_study
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem, within
from cogrip.cli.terminal.tables import plain_table
from cogrip.experiments.study.conductor import Conducted, Conductor, People, Sessions
from cogrip.experiments.study.journal import StudyFolder
from cogrip.experiments.study.laboratory_trial import LaboratorySessions
from cogrip.experiments.study.orders import unfilled
from cogrip.experiments.study.plan import planned
from cogrip.experiments.study.simulated import SimulatedPeople
from cogrip.experiments.study.staircase import uncaught
from cogrip.experiments.study.study_file import BASE, Study, StudyError
from cogrip.experiments.study.table import caught, thresholds
from cogrip.machine.addition import add_integers
from cogrip.machine.platform import system
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.wire.join_link import DEFAULT_PORT

REVERSALS = (
    "reversals: mean of the levels at which tracks turned; above the threshold of whoever is flat or lapses: by a quarter at "
    "slope 1, by a half with 5 % lapses"
)


def study(
    study: Path,
    /,
    *,
    people: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    live: Annotated[bool, Parameter(negative="")] = False,
    remote: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    host: str = "127.0.0.1",
    port: int = DEFAULT_PORT,
    view: Annotated[bool, Parameter(negative="")] = False,
    trigger: str | None = None,
    allow_unstable: AllowUnstable = False,
    out: Path | None = None,
) -> int:
    """Run a study: trials with participants, in virtual time or live; resumable.

    Without --live every trial is a session in virtual time with simulated devices and simulated participants. With --live a
    server and a client for each participant are started for every session; between trials Enter says that somebody is ready.
    The same command goes on where the last one ended, also after a crash: only a trial that was running is begun again.
    `cogrip table` makes a table and figures of what it leaves. Exit code 0 once all trials are over, 130 if some are left.

    Parameters
    ----------
    study
        A study's file, or the name of one that comes with cogrip: stiffness, fitts, delay.
    people
        Participants whose group takes part now, all groups if not given. Repeatable.
    live
        Run sessions live, and ask people at this terminal.
    remote
        Participants who join from elsewhere by themselves, for each session, by the link that is printed. Repeatable.
    host
        Address on which the server of live sessions listens; on any but loopback sessions are encrypted.
    port
        UDP port of live sessions; it stays the same, and so do join links.
    view
        Show each participant a page in the browser: the session, instructions and target, and their questions.
    trigger
        Trigger line of live sessions at every marker, such as their beginning and end: see `cogrip serve`.
    out
        The study's folder, new or to be resumed; else studies/NAME.
    """
    console = make_console(stderr=True, soft_wrap=True)
    asked, base = load_study(study, live=live, allow_unstable=allow_unstable)
    groups = _groups(asked, people)
    within("--port", port, 1, 65535)
    if remote and not live:
        raise BadInput("--remote is for live sessions: add --live, or leave it out")
    if (
        live
        and asked.end == "goal"
        and not all(asked.goal_of(asked.changes(name)).stated for name in asked.conditions or (BASE,))
    ):
        raise BadInput(
            f'{study}: end = "goal", and --live watches a goal of the object alone, no [task]; give goal.place_m and '
            "goal.within_m"
        )
    elsewhere = _remote(asked, remote)
    if view and not live:
        raise BadInput("--view is for live sessions: add --live, or leave it out")
    if live and asked.audio.wanted and not view:
        raise BadInput(f"{study}: [audio] sounds on people's pages; add --view")
    if trigger is not None:
        if not live:
            raise BadInput("--trigger is for live sessions: add --live, or leave it out")
        try_trigger(trigger)
    hands = _hands(asked, base, elsewhere) if live else frozenset()
    if hands and not view:
        raise BadInput(f"{study}: the device of {', '.join(sorted(hands))} is the pointer of a page; add --view")
    path = out or Path(STUDIES) / asked.name.replace(" ", "+")
    with BadInput.of(StudyError), Problem.of(OSError, where=f"--out {path}: cannot be written: "):
        folder = StudyFolder(path, asked, base, "live" if live else "simulated", system.lock)
    if over := add_integers(line.over for line in folder.trials):
        console.print(f"over already, in {path}: {counted(over)}")
    for note in [*folder.notes, *_unfilled(asked), *_uncaught(asked)]:
        console.print(f"note: {note}")
    stop = Stop()
    with closing(folder), on_signals(stop), ExitStack() as stack:
        sessions: Sessions
        who: People
        if live:
            from cogrip.cli.study.live_sessions import LiveSessions
            from cogrip.cli.study.pages import Pages, open_page
            from cogrip.cli.study.terminal_people import Keys, TerminalPeople

            keys = Keys(stop)
            serving = ["--trigger", trigger] if trigger else []
            flags = ["--allow-unstable"] if allow_unstable else []
            page = open_page(asked, path, hands, groups, console, stack) if view else None
            pages = Pages(page, asked.audio)
            sessions = LiveSessions(asked, path, keys, stop, console, elsewhere, host, port, flags, serving, pages)
            who = TerminalPeople(
                keys, console, pages, buttons=asked.start == "button", length=partial(trials_in_words, asked)
            )
        else:
            sessions = LaboratorySessions(asked, lambda: bool(stop.reason))
            who = SimulatedPeople(asked)
        report = _Progress(console, asked)
        with Problem.of(StudyError), Problem.of_files(path, doing="cannot be written: "):
            outcome = Conductor(asked, base, folder, sessions, who, _utc if live else lambda: "", report).run(groups)
    return _conclude(asked, folder, outcome, console)


def trials_in_words(study: Study, group: int) -> str:
    """Return how many trials a group has, in words behind a trial's number; staircases may end sooner."""
    most = "at most " if any(block.staircase for block in study.blocks) else ""
    return f" of {most}{planned(study, group)}"


def _groups(study: Study, people: Sequence[str]) -> list[int]:
    """Return the numbers of the groups of these people, of all for none. Raises BadInput."""
    groups = study.groups()
    known = [name for group in groups for name in group]
    for name in people:
        if name not in known:
            raise BadInput(f"--people {name}: there is no such participant; there is: {', '.join(known)}")
    return [number for number, group in enumerate(groups) if not people or set(group) & set(people)]


def _remote(study: Study, remote: Sequence[str]) -> frozenset[str]:
    known = [name for group in study.groups() for name in group]
    for name in remote:
        if name not in known:
            raise BadInput(f"--remote {name}: there is no such participant; there is: {', '.join(known)}")
    return frozenset(remote)


def _hands(study: Study, base: Mapping[str, Any], elsewhere: frozenset[str]) -> frozenset[str]:
    """Return who moves the pointer of their page in some condition."""
    found = {
        user.name
        for people in study.groups()
        for condition in study.conditions or (BASE,)
        for user in study.settings_of(base, people, study.changes(condition), study.seed).users
        if is_web(user.device)
    }
    return frozenset(found) - elsewhere


def counted(trials: int) -> str:
    """Return a number of trials in words."""
    return f"{trials} trial{'' if trials == 1 else 's'}"


def _utc() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _unfilled(study: Study) -> list[str]:
    """Return which Latin squares the participants do not fill."""
    squares = [(block, len(study.conditions_of(block))) for block in study.blocks if block.order == "latin"]
    groups = len(study.groups())
    return [
        f"block {block.name}: {why}" for block, size in squares if (why := unfilled(size, block.repetitions, groups))
    ]


def _uncaught(study: Study) -> list[str]:
    """Return what the thresholds of blocks without catch trials are worth."""
    rules = [(block.name, block.staircase) for block in study.blocks if block.staircase is not None]
    return [f"block {name}: {why}" for name, rule in rules if (why := uncaught(rule))]


class _Progress:
    """Prints a line a group, and one now and then."""

    def __init__(self, console: Console, study: Study) -> None:
        self._console, self._study = console, study
        self._printed: dict[int, int] = {}

    def __call__(self, group: int, done: int, planned: int) -> None:
        step = max(1, planned // 10)
        if group not in self._printed or done // step > self._printed[group]:
            self._printed[group] = done // step
            people = " and ".join(self._study.groups()[group])
            self._console.print(f"{people}: {done} of {planned} trials")


def _conclude(study: Study, folder: StudyFolder, outcome: Conducted, console: Console) -> int:
    finished = [line for line in folder.trials if line.status == "finished"]
    found = thresholds(study, finished)
    if found:
        rows = [
            (
                *key,
                f"{each.threshold:.3g}",
                f"{each.low:.3g} to {each.high:.3g}",
                "-" if each.reversals is None else f"{each.reversals:.3g}",
                f"{100.0 * each.correct:.0f} %",
                str(each.trials),
            )
            for key, each in found.items()
        ]
        headings = ("participant", "block", "condition", "threshold", "95 %", "reversals", "right", "trials")
        make_console().print(plain_table(headings, rows, left=3))
        console.print(REVERSALS)
        for note in _uncaught(study):
            console.print(f"warning: {note}")
        for (person, block, condition), each in found.items():
            for warning in each.warnings:
                console.print(f"warning: {person}, {block}, {condition}: {warning}")
    for (person, block), (wrong, asked) in caught(finished).items():
        console.print(f"{person}, {block}: {wrong} of {asked} catch trials answered wrongly")
    abandoned = f", {outcome.abandoned} abandoned" if outcome.abandoned else ""
    console.print(f"{counted(outcome.finished)} finished{abandoned}, {outcome.now} of them now; in {folder.path}")
    if outcome.complete:
        console.print(f"`cogrip table {folder.path} --to csv` makes a table of them")
        return 0
    last = folder.trials[-1] if folder.trials else None
    if last is not None and last.status == "failed":
        console.print(f"a session failed again and again: {last.reason}; the same command goes on from here")
        return 1
    console.print("the same command goes on from here")
    return 130
