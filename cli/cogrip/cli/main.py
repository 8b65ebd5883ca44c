"""The commands by group, and how their errors reach a person."""

import gc
import os
import signal
import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError, Group, Parameter
from rich.console import Console

from cogrip.cli.terminal.commands import Table, add_commands, show_docstrings, shown_default
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.platform import use_utf8
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.machine.blas_threads import BLAS_THREADS, SAFE_PATH
from cogrip.machine.large_pages import use_large_pages
from cogrip.protocol.foreign_file import ForeignFileError

GROUPS: dict[str, Table] = {
    "Session": {
        "demo": ("session.demo:demo", "Two simulated people hold one cube over UDP on this machine; ends with a report."),
        "serve": ("serving.serve:serve", "Serve the shared object of one or several settings files."),
        "join": ("session.join:join", "Join a server with one force-feedback device, real or simulated; or observe."),
        "relay": ("serving.relay:relay", "Put an emulated network between any two programs that speak UDP."),
        "view": ("session.view:view", "Show a session or a recording in the browser."),
        "gateway": ("serving.gateway:gateway", "Let people take part who have only a browser: pages and hands, over TLS."),
        "lsl": ("session.lsl:lsl", "Offer a session to the Lab Streaming Layer: state and markers as streams."),
        "lab": ("session.lab:lab", "Run a whole session in virtual time, without sleeping."),
        "configs": ("session.configs:configs", "Settings that come with cogrip, by name: list, show, copy."),
    },
    "Runs": {
        "runs": ("runs.listing:runs", "List the recorded runs, newest first."),
        "report": ("runs.report:report", "Write the report of a run, or of several compared."),
        "export": ("runs.export:export", "Write a run as tables, a bag of ROS 2 or a layout for Foxglove; a study as BIDS."),
        "replay": ("runs.replay:replay", "Replay a recorded session: bit for bit, or as what-if."),
        "merge": ("runs.merge:merge", "Merge the recordings of one run from several machines."),
        "recover": ("runs.recover:recover", "Recover what is whole of a recording that was cut short or damaged."),
    },
    "Study": {
        "advise": ("study.advise:advise_command", "Advise on stability, feel and improvements before anyone holds a device."),
        "stability": ("study.stability:stability", "Stability: spectral radius, largest stable stiffness, stable region."),
        "feel": ("study.feel:feel", "What a hand will feel: stiffness, damping, inertia, impedance, delays."),
        "sweep": ("study.sweep:sweep", "Run sessions, or their linear models, over a grid of settings; resumable."),
        "compare": ("study.compare:compare", "Compare coupling methods under the same hands over network profiles; resumable."),
        "study": ("study.study:study", "Run a study: trials with participants, live or in virtual time; resumable."),
        "table": ("study.table:table", "Write one tidy table of a study, and figures of its measures."),
        "figures": ("study.figures:figures", "Draw the paper's figures, and ours beside them."),
    },
    "Devices": {
        "devices": ("devices.commands:devices", "Devices: list, find, wizard, calibrate, check, commission, conform, emulate."),
    },
    "Worlds": {
        "worlds": ("worlds.commands:worlds", "Worlds, also your own: list, check."),
    },
    "Administration": {
        "token": ("admin.token:token", "Tokens, the rights to join an encrypted server: new, list, revoke, keys."),
        "who": ("admin.who:who", "List who is seated or observes in a running server."),
        "mark": ("admin.mark:mark", "Set a marker in a running session, in every recording of it."),
        "set": ("admin.set_values:set_values", "Change settings of a person, or of a room, in a running session."),
        "room": ("admin.room:room", "Rooms on demand: new, list, close."),
        "kick": ("admin.kick:kick", "Kick somebody from a running session."),
        "drain": ("admin.drain:drain", "Let the rooms of a host of a cluster move to others."),
        "compile": ("admin.compile:compile_", "Compile what costs time in a tick; the same numbers in half the time."),
        "doctor": ("admin.doctor:doctor", "Measure what this machine can do in real time, and advise how to improve it."),
    },
}  # fmt: skip
COMMANDS = tuple(name for table in GROUPS.values() for name in table)

MOVED = {"bench": "benchmarks are run in a checkout of cogrip: `python3 dev.py bench NAME`"}
"""Commands of earlier versions, and what to run instead."""


def version() -> str:
    """Return the version of this software."""
    from cogrip.protocol.version import VERSION  # which looks through all that is installed

    return VERSION


app = App(
    name="cogrip",
    version=version,
    version_format="plaintext",
    help_format="plaintext",  # of the list of commands: what reads Markdown takes as long as all else to import
    help="Several people hold one virtual object together over a network, and feel it and each other.",
    suppress_keyboard_interrupt=False,
    default_parameter=Parameter(show_default=shown_default),
)
for _number, (_group, _table) in enumerate(GROUPS.items()):
    add_commands(app, _table, Group(_group, sort_key=_number))
_options = Group("Options", sort_key=len(GROUPS))
for _flag in (*app.help_flags, *app.version_flags):
    app[_flag].group = _options


def _tell(errors: Console, text: str) -> None:
    """Print an error: one line, which a terminal has wrapped at its width and between words."""
    from cogrip.cli.terminal.tables import wrapped  # as `flag_errors` below: nothing that goes well needs it

    errors.print(wrapped(text, errors) if errors.is_terminal else text, markup=False, soft_wrap=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command: `arguments`, or the process's own.

    Exit codes: 0 well, 1 a run that failed or was not passive, 2 bad input, 130 interrupted.
    """
    # Our matrices are small: threads that wait for each other took eleven times the processor. What the user set stays.
    if not any(os.environ.get(name) for name in BLAS_THREADS):
        os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
    if arguments is None:  # this is a process of its own: those that it starts import nothing from where it stands
        os.environ[SAFE_PATH] = "1"
        use_large_pages()  # before the command imports what it needs
    use_utf8()
    errors = make_console(stderr=True, soft_wrap=True)
    given = sys.argv[1:] if arguments is None else arguments
    if given and given[0] in MOVED:
        _tell(errors, f"cogrip: {MOVED[given[0]]}")
        return 2
    try:
        show_docstrings(app, given)
        _have_imported(own=arguments is None)
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        from cogrip.cli.terminal.flag_errors import words_of

        _tell(errors, f"cogrip: {words_of(error, COMMANDS)}")
        return 2
    except Problem as problem:
        _tell(errors, f"cogrip: {problem}")
        return problem.exit_code
    except ForeignFileError as error:
        _tell(errors, f"cogrip: {error}")
        return BadInput.exit_code
    except KeyboardInterrupt:
        errors.print("cogrip: interrupted")
        return 130
    except BrokenPipeError:
        return 1
    except Exception as error:
        if not _is_interrupt(error):
            raise
        errors.print("cogrip: interrupted")
        return 130
    return code if isinstance(code, int) else 0


def _have_imported(own: bool) -> None:
    """Let Ctrl-C be an exception from now on, where it has ended the process so far: all that it calls is imported.

    own: of a process of its own, also never look at that for garbage, not even at the end: it took a seventh of `configs`.
    """
    if own:
        gc.freeze()
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _is_interrupt(error: BaseException | None) -> bool:
    """Return whether an extension module has made this error of a KeyboardInterrupt, as some do while they are imported."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


if __name__ == "__main__":
    sys.exit(main())
