"""`cogrip table`: one tidy table of a study, and figures of its measures."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.experiments.study.fitts import COLUMNS, ENOUGH, FEWEST, pointing, rows_of, throughputs
from cogrip.experiments.study.phase_table import COLUMNS as PHASE_COLUMNS
from cogrip.experiments.study.study_file import StudyError
from cogrip.experiments.study.table import read_table, write_columns, write_table
from cogrip.results.reading.export import ExportError, Format


def table(
    study: Path, /, *, to: Format, out: Path | None = None, figures: Annotated[bool, Parameter(negative="")] = False
) -> int:
    """Write one tidy table of a study: a row a person and session, ready for R or pandas.

    Columns say where the session stood in the study and what it set, then come the measures, with their units in their names
    (docs/measures.md), and the answers. Trials that were abandoned or begun again are left out. Nothing is overwritten. Where
    conditions have a target, effective width, index of difficulty and throughput (ISO 9241-411) stand in a second table; where
    trials have phases, measures of each in a third.

    Parameters
    ----------
    study
        A study's folder, such as studies/fitts.
    to
        Format of the table; parquet needs the extra `parquet`.
    out
        Path of the table; else table.csv or table.parquet in the study's folder.
    figures
        Draw a figure a measure too, over conditions, into the study's folder figures/.
    """
    console, errors = make_console(soft_wrap=True), make_console(stderr=True, soft_wrap=True)
    path = out or study / f"table.{to}"
    second = path.with_name(f"{path.stem}-throughput{path.suffix}")
    third = path.with_name(f"{path.stem}-phases{path.suffix}")
    for each in (path, second, third):
        if each.exists():
            raise BadInput(f"{each} exists, and nothing is overwritten; remove it, or name another by --out")
    with BadInput.of(StudyError), errors.status("measuring") as status:
        found = read_table(study, lambda done, total: status.update(f"measuring trial {done + 1} of {total}"))
    if not found.rows:
        raise Problem(f"{study}: no trial is finished yet; `cogrip study` runs them")
    with Problem.of_files(path, doing="cannot be written: "), BadInput.of(ExportError):
        write_table(found, to, path)
        console.print(f"{path}: {len(found.rows)} row{'' if len(found.rows) == 1 else 's'}")
        if pointed := pointing(found):
            write_columns(COLUMNS, rows_of(pointed), to, second)
            console.print(f"{second}: {len(pointed)} row{'' if len(pointed) == 1 else 's'}")
            if not (told := throughputs(pointed)):
                console.print(
                    f"no throughput: it takes {FEWEST} trials of a group in a condition, whose end points differ"
                )
            for group, value in told.items():
                more = f"; {100 * ENOUGH:.0f} % takes some {value.trials} trials a condition"
                console.print(
                    f"group {group}: throughput {value.bitps:.2f} +- {value.within_bitps:.2f} bit/s (ISO 9241-411, 95 %"
                    f"{more if value.within_bitps > ENOUGH * value.bitps else ''})"
                )
        if found.phases:
            values = [[row[column.name] for row in found.phases] for column in PHASE_COLUMNS]
            write_columns(PHASE_COLUMNS, values, to, third)
            console.print(f"{third}: {len(found.phases)} rows")
        if figures:
            from cogrip.experiments.study.figures import write_figures

            for drawn in write_figures(found, study / "figures"):
                console.print(f"figure: {drawn}")
    for note in found.notes:
        errors.print(f"warning: {note}")
    for note in found.empty:
        errors.print(f"note: {note}")
    return 0
