"""`cogrip report`: the page on one run, or a comparison of several."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from cogrip.cli.runs.compared_table import compared_table
from cogrip.cli.runs.recovered import recover_unclosed
from cogrip.cli.runs.run_folder import RUNS, found_run
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.parameters import RunsBelow
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import say
from cogrip.protocol.recording.reader import RecordingError
from cogrip.results.comparison.differences import ComparisonError, RunDifference, labels_of

COMPARISON = Path("comparison.html")


def report(*run: Path, out: Path | None = None, runs: RunsBelow = RUNS) -> int:
    """Write the report of a run, or of several compared.

    That of one run is written anew into its folder. The page is self-contained. Exit code 0 whatever the verdicts.

    Parameters
    ----------
    run
        Run folders, or their names in `runs` (--runs); the differences of several are against the first.
    out
        Where the page on several runs is written; else comparison.html in the current folder. A comparison that stands there
        is replaced, any other file is not.
    """
    run = tuple(found_run(folder, runs) for folder in run)
    _check(run, out)
    console, errors = make_console(soft_wrap=True), make_console(stderr=True, soft_wrap=True)
    for folder in run:
        with suppress(FileNotFoundError):  # there is none: the page says so
            recover_unclosed(folder, errors)
    try:
        with errors.status("writing the report"):
            page, rows, notes = _write(run, out or COMPARISON)
    except (ComparisonError, RecordingError) as error:
        raise BadInput(f"report: {error}") from None
    except OSError as error:
        words = f"{error.filename}: {error.strerror}; write to another folder" if error.strerror else str(error)
        raise BadInput(f"report: {words}") from None
    if rows:
        console.print(compared_table(rows, labels_of(run)))
        for note in notes:
            say(console, note)
    console.print(f"report: {page}")
    return 0


def _check(run: Sequence[Path], out: Path | None) -> None:
    if not run:
        raise BadInput("report: name at least one run folder; `cogrip runs` lists them")
    for folder in run:
        if folder.is_file():
            raise BadInput(f"{folder}: is a file; name the run folder in which it stands")
    whole = [folder.resolve() for folder in run]
    for number, folder in enumerate(whole):
        if folder in whole[:number]:
            raise BadInput(f"{run[number]}: is named twice; name each run once")
    if out is not None and len(run) == 1:
        raise BadInput(f"--out {out}: is for several runs; the report of one stands in its folder")
    if out is not None and not out.absolute().parent.is_dir():
        raise BadInput(f"--out {out}: there is no folder {out.absolute().parent}; make it first, or name another")


def _write(run: Sequence[Path], out: Path) -> tuple[Path, list[RunDifference], list[str]]:
    if len(run) == 1:
        from cogrip.results.report.page import write_report

        return write_report(run[0]), [], []
    from cogrip.results.report.compared import write_comparison

    return write_comparison(out, run)
