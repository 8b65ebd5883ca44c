"""Progress of many sessions, and which form of cogrip runs them: for commands that take a while."""

from collections.abc import Callable
from time import perf_counter

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from cogrip.machine.compiled_files import compile_command, form, why_interpreted

_PRINT_EVERY = 0.1  # share of the whole from one print to the next, where there is no terminal to draw a bar on


def form_line() -> str:
    """Return which form runs, and how the faster one is had."""
    if form() == "compiled":
        return "compiled"
    why = why_interpreted()
    return f"interpreted: {why}; `{compile_command()}` makes it several times faster" if why else "interpreted"


class SessionProgress:
    """A bar on a terminal, elsewhere a line at times; at the end how many were finished a second.

    Gives a function of the number of finished ones. what: their name; finished: those that were so before
    """

    def __init__(self, console: Console, what: str, total: int, finished: int = 0) -> None:
        self._console, self._what, self._total = console, what, total
        self._before = self._finished = self._printed = finished
        self._began_s = perf_counter()
        self._bar = Progress(
            TextColumn("[progress.description]{task.description}"), BarColumn(), MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"), TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True,
        )  # fmt: skip

    def __enter__(self) -> Callable[[int], None]:
        self._console.print(f"{self._total} {self._what}, {form_line()}", highlight=False)
        if not self._console.is_terminal:
            return self._print
        task = self._bar.add_task(self._what, total=self._total, completed=self._before, rate="")
        self._bar.start()

        def update(finished: int) -> None:
            self._finished = finished
            self._bar.update(task, completed=finished, rate=f"{self._rate():.1f} a second")

        return update

    def __exit__(self, *ending: object) -> None:
        self._bar.stop()
        if done := self._finished - self._before:
            took_s = perf_counter() - self._began_s
            self._console.print(f"{done} {self._what} in {took_s:.1f} s: {self._rate():.1f} a second", highlight=False)

    def _rate(self) -> float:
        return (self._finished - self._before) / max(1e-9, perf_counter() - self._began_s)

    def _print(self, finished: int) -> None:
        self._finished = finished
        if finished == self._total or finished - self._printed >= max(1.0, _PRINT_EVERY * self._total):
            self._printed = finished
            self._console.print(f"{finished} of {self._total} {self._what}")
