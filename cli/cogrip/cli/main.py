"""The table of commands, and how their errors reach a person."""

import os
import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError

from cogrip.cli.terminal.console import make_console
from cogrip.cli.terminal.flag_errors import words_of
from cogrip.cli.terminal.problem import Problem
from cogrip.protocol.version import VERSION
from cogrip.sim.blas_threads import BLAS_THREADS, SAFE_PATH

COMMANDS = {
    "demo": (
        "cogrip.cli.session.demo:demo",
        "Two simulated people hold one cube over UDP on this machine; ends with a report.",
    ),
    "serve": ("cogrip.cli.session.serve:serve", "Serve the shared object of one or several settings files."),
    "join": ("cogrip.cli.session.join:join", "Join a server with one force-feedback device, real or simulated."),
    "relay": ("cogrip.cli.session.relay:relay", "Put an emulated network between any two programs that speak UDP."),
    "replay": ("cogrip.cli.runs.replay:replay", "Play a recorded session again: bit by bit, or as what if."),
    "runs": ("cogrip.cli.runs.listing:runs", "List the recorded runs, newest first."),
    "report": ("cogrip.cli.runs.report:report", "Write the report of a run, or of several compared."),
    "export": ("cogrip.cli.runs.export:export", "Write a run's recordings as CSV or Parquet tables."),
    "recover": ("cogrip.cli.runs.recover:recover", "Save what is whole of a recording that was cut short or damaged."),
    "merge": ("cogrip.cli.runs.merge:merge", "Bring the recordings of one run from several machines together."),
    "lab": ("cogrip.cli.session.lab:lab", "Run a whole session in virtual time, without sleeping."),
    "advise": (
        "cogrip.cli.study.advise:advise_command",
        "Say before anyone holds a device whether a session is stable, what it will feel like, and what would help.",
    ),
    "stability": (
        "cogrip.cli.study.stability:stability",
        "Say whether a session is stable, up to which stiffness, and in which region.",
    ),
    "feel": (
        "cogrip.cli.study.feel:feel",
        "Say what a hand will feel: stiffness, damping, inertia, impedance, delays.",
    ),
    "figures": ("cogrip.cli.study.figures:figures", "Draw the paper's figures, and ours beside them."),
    "sweep": (
        "cogrip.cli.study.sweep:sweep",
        "Run sessions, or their linear models, over a grid of settings; resumable.",
    ),
    "compare": (
        "cogrip.cli.study.compare:compare",
        "Compare methods of sharing an object under the same hands, on networks as they are: one table; resumable.",
    ),
    "configs": ("cogrip.cli.session.configs:configs", "Settings that come with cogrip, by name: list, show, copy."),
    "devices": ("cogrip.cli.devices.commands:devices", "Devices: list, find, calibrate, check, emulate."),
    "token": ("cogrip.cli.admin.token:token", "Tokens: make, list, revoke the rights to come into a sealed server."),
    "who": ("cogrip.cli.admin.who:who", "List who sits and looks on in a running server."),
    "kick": ("cogrip.cli.admin.kick:kick", "Show somebody out of a running session."),
    "doctor": (
        "cogrip.cli.admin.doctor:doctor",
        "Measure what this machine can do in real time, and say how to do better.",
    ),
}

MOVED = {"bench": "benchmarks need a checkout of cogrip: run `python3 dev.py bench NAME` there"}
"""Commands of earlier versions, and what to run instead."""

app = App(
    name="cogrip",
    version=VERSION,
    help="Several people hold one virtual object together over a network, and feel it and each other.",
    suppress_keyboard_interrupt=False,
)
for _name, (_target, _help) in COMMANDS.items():
    app.command(_target, name=_name, help=_help)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command: `arguments`, or the process's own.

    Exit codes: 0 well, 1 a run that failed or was not passive, 2 bad input, 130 interrupted.
    """
    # Our matrices are small: threads that wait for each other took eleven times the processor. What the user set stays.
    if not any(os.environ.get(name) for name in BLAS_THREADS):
        os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
    if arguments is None:  # this is a process of its own: those that it starts import nothing from where it stands
        os.environ[SAFE_PATH] = "1"
    errors = make_console(stderr=True, soft_wrap=True)
    given = sys.argv[1:] if arguments is None else arguments
    if given and given[0] in MOVED:
        errors.print(f"cogrip: {MOVED[given[0]]}", markup=False)
        return 2
    try:
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        errors.print(f"cogrip: {words_of(error, tuple(COMMANDS))}", markup=False)
        return 2
    except Problem as problem:
        errors.print(f"cogrip: {problem}", markup=False)
        return problem.exit_code
    except KeyboardInterrupt:
        errors.print("cogrip: interrupted", markup=False)
        return 130
    except BrokenPipeError:
        return 1
    return code if isinstance(code, int) else 0


if __name__ == "__main__":
    sys.exit(main())
