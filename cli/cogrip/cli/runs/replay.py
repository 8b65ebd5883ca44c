"""`cogrip replay`: verify that a recorded session replays exactly, or run it again as what-if, with other settings."""

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rich.console import Console

from cogrip.cli.runs.compared_table import compared_table
from cogrip.cli.runs.run_folder import new_run_folder, opened
from cogrip.cli.runs.summary_table import verdict_lines
from cogrip.cli.settings.before_run import AllowUnstable, check_settings
from cogrip.cli.settings.settings_file import override, try_session
from cogrip.cli.settings.settings_origin import SET
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.parameters import Overrides, Runs
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import say as say_lines
from cogrip.machine.addition import add_integers
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.recording.header import versions_here
from cogrip.protocol.recording.reader import Recording, RecordingError
from cogrip.protocol.recording.records import Gap
from cogrip.protocol.settings.table import SettingsError
from cogrip.results.comparison.differences import ComparisonError
from cogrip.results.reading.records import RunRecords
from cogrip.results.reading.traces import describe
from cogrip.results.replay.verify import ReplayVerdict
from cogrip.results.replay.verify import verify as verify_recording
from cogrip.results.replay.what_if import Hands, folder_name, label
from cogrip.results.replay.what_if import what_if as other_world
from cogrip.results.verdict.verdict import succeeded

UNCHANGED = "unchanged, in the laboratory"
WORTH_WORKERS_BYTES = 8_000_000


def replay(
    run: Path,
    /,
    *,
    verify: bool = False,
    what_if: bool = False,
    overrides: Overrides = (),
    hands: Hands = "same",
    allow_unstable: AllowUnstable = False,
    runs: Runs = Path("runs"),
    json: Json = None,
) -> int:
    """Replay a recorded session: bit for bit, or as what-if.

    --verify feeds the recorded inputs into the same cores and compares every output bit for bit; exit code 1 and the
    first difference if there is one. --what-if runs the same hands with other settings, in virtual time, and compares; exit
    code 0 only if that run was passive and stable, devices included.

    Parameters
    ----------
    run
        Run folder, or its name in `runs` (--runs), or one of its .mcap files.
    verify
        Compare all outputs with the recording.
    what_if
        Run the hands again with the settings changed by --set.
    hands
        How people take part in --what-if: `same` simulated hand (others through an impedance); their recorded effort
        behind an `impedance`; or their recorded `positions`, whatever the force.
    """
    if verify == what_if:
        raise BadInput("replay: say either --verify or --what-if")
    if overrides and verify:
        raise BadInput("replay: --set goes with --what-if; --verify replays what was recorded")
    records = opened(run, runs)
    console = make_console(soft_wrap=True)
    if verify:
        return _verify(records, console, json)
    if json:
        raise BadInput("replay: --json goes with --verify; --what-if leaves a run folder with its summary.json")
    return _what_if(records, overrides, hands, allow_unstable, runs, console)


def _verify(records: RunRecords, console: Console, json: str | None) -> int:
    ends = [*records.clients.values(), *([records.server] if records.server else [])]

    def say(text: str) -> None:
        if json != "-":
            say_lines(console, text)

    for note in records.notes:
        say(f"note: {note}")
    for end in ends:  # before, not after
        if differences := end.recording.header.versions.differences(versions_here()):
            say(f"note: {end.path.name} was recorded by other versions: {'; '.join(differences)}")
    with BadInput.of(RecordingError):
        found = {
            end.path.name: verdict
            for end, verdict in zip(ends, _verdicts([end.recording for end in ends]), strict=True)
        }
    for file, verdict in found.items():
        for line in _words(file, verdict):
            say(line)
    exact = not records.unreadable and all(verdict.exact for verdict in found.values())
    if json:
        files = [_as_json(file, verdict) for file, verdict in found.items()]
        write_json({"exact": exact, "files": files, "unreadable": [str(path) for path in records.unreadable]}, json)
    return 0 if exact else 1


def _verdicts(recordings: list[Recording]) -> list[ReplayVerdict]:
    """Return one for each; those of a long run are found in parallel. Raises RecordingError."""
    workers = min(len(recordings), os.cpu_count() or 1)
    if workers < 2 or add_integers(each.path.stat().st_size for each in recordings) < WORTH_WORKERS_BYTES:
        return [verify_recording(each) for each in recordings]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return list(pool.map(verify_recording, recordings))


def _words(file: str, verdict: ReplayVerdict) -> list[str]:
    what = "steps" if verdict.who == "server" else "ticks"
    played = f"{verdict.messages} messages, {verdict.ticks} {what}, {verdict.seconds:.3f} s"
    lines = []
    if (found := verdict.difference) is not None:
        at_s = (found.time_ns - verdict.start_ns) * 1e-9
        where = f"{found.topic} {found.field}".strip()
        lines.append(f"differs at {at_s:.6f} s in {where}: recorded {found.recorded}, replayed {found.replayed}")
        lines.append(f"equal until then: {played}")
    else:
        lines.append(f"{'equal' if verdict.exact else 'equal up to a hole'}, bit for bit: {played}")
    if isinstance(verdict.hole, Gap):
        lines.append(
            f"{verdict.hole.messages} messages are missing ({verdict.hole.reason}): nothing after can be compared"
        )
    elif verdict.hole is not None:
        lines.append(f"{describe(verdict.hole, -verdict.start_ns * 1e-9)}: nothing after can be compared")
    if verdict.cut:
        lines.append("its end is missing; what is there was compared")
    return [f"{file}: {line}" for line in lines]


def _as_json(file: str, verdict: ReplayVerdict) -> dict[str, Any]:
    found = verdict.difference
    difference = found and {
        "time_s": (found.time_ns - verdict.start_ns) * 1e-9, "topic": found.topic, "field": found.field,
        "recorded": found.recorded, "replayed": found.replayed,
    }  # fmt: skip
    return {
        "file": file, "exact": verdict.exact, "messages": verdict.messages, "ticks": verdict.ticks,
        "seconds": verdict.seconds, "cut": verdict.cut, "hole": verdict.hole is not None,
        "versions": list(verdict.versions), "difference": difference,
    }  # fmt: skip


def _what_if(
    records: RunRecords, overrides: tuple[str, ...], hands: Hands, allow_unstable: bool, runs: Path, console: Console
) -> int:
    changes = dict(override(text) for text in overrides)
    worlds = {f"with {label(changes)}" if changes else UNCHANGED: (changes, "")}
    if changes and not records.virtual:  # so that the effect of virtual time alone can be seen
        worlds = {UNCHANGED: ({}, "unchanged"), **worlds}
    with BadInput.of(RecordingError), BadInput.of(SettingsError, where=SET if changes else ""):
        made = {name: other_world(records, changes, hands) for name, (changes, _) in worlds.items()}
    for name, world in made.items():
        try_session(world.settings, "")
        if name == next(reversed(worlds)):  # the recorded settings may be run again: only the changed ones are refused
            check_settings(world.settings, allow_unstable or not changes, world.overloads)
    from cogrip.results.report.compared import write_comparison
    from cogrip.results.report.page import write_report
    from cogrip.results.writing.laboratory_run import run_laboratory

    folder = new_run_folder(runs, folder_name(records))
    folders = {name: folder / place for name, (_, place) in worlds.items()}
    outcomes, stop = {}, Stop()
    with on_signals(stop), console.status("running the changed session"):
        for name, world in made.items():
            if stop.reason:  # nothing can be told of a session that never began
                break
            folders[name].mkdir(exist_ok=True)
            outcomes[name] = run_laboratory(world.settings, folders[name], None, stop, world.begins)
    run = {name: folders[name] for name in outcomes}
    if not run:
        console.print(f"interrupted: nothing was run; {folder} is empty")
        return 130
    cut = [f"interrupted: {_cut(list(made), list(run))}"] if stop.reason else []
    with console.status("writing the reports"):
        if folder in run.values():
            write_report(folder)
        labels = ["as recorded", *run]
        try:
            page, rows, notes = write_comparison(
                folder / "comparison.html", [records.folder, *run.values()], labels, [f"I{line[1:]}" for line in cut]
            )
        except ComparisonError as error:
            raise BadInput(f"{error}; the changed session's run is in {folder}") from None
    console.print(compared_table(rows, labels))
    for note in notes:
        say_lines(console, note)
    for name, outcome in outcomes.items():
        console.print(f"{name}:")
        console.print(verdict_lines(outcome.summary))
    console.print(f"comparison: {page}")
    if cut:
        say_lines(console, cut[0])
        return 130
    return 0 if succeeded(outcome.summary) else 1


def _cut(wanted: list[str], begun: list[str]) -> str:
    """Return what an interruption left out, in words."""
    text = f"{begun[-1]!r} was cut short"
    missing = [name for name in wanted if name not in begun]
    return f"{text}, {' and '.join(map(repr, missing))} was not run." if missing else f"{text}."
