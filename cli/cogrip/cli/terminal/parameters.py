"""Parameters that several commands share, with their help."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

Config = Annotated[Path, Parameter(help="Settings file, or the name of one that comes with cogrip (`cogrip configs`).")]
Overrides = Annotated[
    tuple[str, ...],
    Parameter(
        name="--set", negative="", help="Override a setting: section.key=value. Repeatable; a user's are users.0.key."
    ),
]
Hands = Annotated[
    tuple[str, ...],
    Parameter(
        name="--hands",
        negative="",
        help="Hand of the first, second ... person in place of the settings' (such as csv:FILE&time=t_s&x=x_m). Repeatable.",
    ),
]
Devices = Annotated[
    tuple[str, ...],
    Parameter(
        name="--device",
        negative="",
        help="Device address of the first, second ... person in place of the settings' (`cogrip devices`). Repeatable.",
    ),
]
Workers = Annotated[int | None, Parameter(help="Worker processes; else one for each processor.")]
Runs = Annotated[Path, Parameter(help="Folder in which the run's own folder is made.")]
RunsBelow = Annotated[Path, Parameter(help="Folder of the runs that are given by their names alone.")]
Report = Annotated[bool, Parameter(help="Write report.html and plots at the end.")]
Record = Annotated[bool, Parameter(help="Record the session; every replay, report and verification needs it.")]
Quiet = Annotated[bool, Parameter(negative="", help="Show no live table at a terminal, only lines.")]
