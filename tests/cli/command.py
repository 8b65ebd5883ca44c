"""Commands as their users type them, run in this process."""

import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console, RenderableType


def printed(what: RenderableType, width: int) -> str:
    """Return what a console of some width shows, without colours."""
    console = Console(width=width, color_system=None)
    with console.capture() as captured:
        console.print(what)
    return captured.get()


class Cogrip:
    """Run one command, and return exit code, standard output and standard error.

    The first text is split as a shell splits it. before, after: words of every command.
    """

    def __init__(
        self, main: Callable[[list[str]], int], capsys: pytest.CaptureFixture[str], before: tuple[object, ...] = (),
        after: tuple[object, ...] = (),
    ) -> None:  # fmt: skip
        self._main, self._capsys, self._before, self._after = main, capsys, before, after

    def __call__(self, *arguments: object) -> tuple[int, str, str]:
        self._capsys.readouterr()
        for first in arguments[:1]:
            arguments = (*(shlex.split(str(first)) or [first]), *arguments[1:])
        code = self._main([str(argument) for argument in (*self._before, *arguments, *self._after)])
        captured = self._capsys.readouterr()
        assert "Traceback" not in captured.err
        return code, captured.out, captured.err

    def within(self, *before: object, after: tuple[object, ...] = ()) -> "Cogrip":
        """Return the same for commands that all begin and end with these words."""
        return Cogrip(self._main, self._capsys, before, after)

    def texts(self, *arguments: object, code: int = 0) -> tuple[str, str]:
        """Return standard output and standard error of a command that ends with `code`."""
        found, out, err = self(*arguments)
        assert found == code, out + err
        return out, err

    def out(self, *arguments: object, code: int = 0) -> str:
        """Return standard output of a command that ends well."""
        return self.texts(*arguments, code=code)[0]

    def err(self, *arguments: object, code: int = 2) -> str:
        """Return standard error of a command that is refused."""
        return self.texts(*arguments, code=code)[1]

    def answer(self, *arguments: object, code: int = 0) -> Any:
        """Return the answer of a command that gives one as JSON."""
        return json.loads(self.out(*arguments, "--json", "-", code=code))

    def refuses(self, words: str, *arguments: object, code: int = 2) -> None:
        """Check that a command is refused in these words, and leaves nothing in the current folder."""
        before = _files_of_the_current_folder()
        said = "".join(self.texts(*arguments, code=code))
        assert words in said, said
        assert _files_of_the_current_folder() == before


def _files_of_the_current_folder() -> list[Path]:
    """List what a command could have left; of a checkout its top alone, as other tests write caches below it."""
    if (Path() / "pyproject.toml").exists():
        return sorted(path for path in Path().iterdir() if not path.name.startswith((".", "__")))
    return sorted(Path().rglob("*"))
