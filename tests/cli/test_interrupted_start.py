"""Ctrl-C while a command begins: no traceback, whatever is being imported."""

import os
import signal
import subprocess
import sys

import pytest

from cogrip.cli import main as command
from cogrip.machine.platform import system

from tests.cli.command import Cogrip

START = """
import os, signal, sys

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
from cogrip.cli.start import main
sys.exit(main())
"""


def started(name: str, *arguments: str) -> tuple[int, str]:
    """Return exit code and output of a command that is interrupted as it imports a module."""
    ran = subprocess.run(
        [sys.executable, "-P", "-c", START.format(name=name), *arguments], capture_output=True, text=True, timeout=100,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    return ran.returncode, ran.stdout + ran.stderr


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize(
    "name", ["cogrip.cli.main", "cyclopts", "cogrip.cli.serving.serve", "cogrip.server.io.udp_socket"]
)
def test_while_modules_are_imported_it_ends_the_process_and_nothing_is_said(name: str) -> None:
    assert started(name, "serve", "demo", "--port", "0", "--seconds", "1") == (-signal.SIGINT, "")


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_what_a_running_command_imports_is_interrupted_in_one_line() -> None:
    code, said = started("cogrip.results.listing.listing", "runs")
    assert (code, said) in ((130, "cogrip: interrupted\n"), (-signal.SIGINT, ""))


def test_what_an_extension_module_makes_of_it_is_one_line(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise ImportError("initialization failed") from error

    monkeypatch.setattr(command, "app", fails)
    monkeypatch.setattr(command, "show_docstrings", lambda *_: None)
    assert cogrip("runs") == (130, "", "cogrip: interrupted\n")


def test_an_error_of_its_own_is_no_interrupt(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise ImportError("no module")

    monkeypatch.setattr(command, "app", fails)
    monkeypatch.setattr(command, "show_docstrings", lambda *_: None)
    with pytest.raises(ImportError, match="no module"):
        cogrip("runs")


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_process_that_ignores_the_end_of_others_is_not_ended_before_it_does(number: signal.Signals) -> None:
    program = (
        f"import os; os.kill(os.getpid(), {number:d})\n"
        "from cogrip.machine.platform import system\n"
        "system.ignore_end_signals()\n"
        f"os.kill(os.getpid(), {number:d})\n"
        "import signal; print('on', signal.pthread_sigmask(signal.SIG_BLOCK, ()))\n"
    )
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    with system.end_signals_held():
        started = subprocess.Popen([sys.executable, "-P", "-c", program], stdout=subprocess.PIPE, text=True)
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before
    assert started.communicate(timeout=100)[0] == "on set()\n"
    assert started.returncode == 0
