"""Factory of every console that cogrip prints on."""

from typing import IO

from rich.console import Console


def make_console(
    *,
    stderr: bool = False,
    soft_wrap: bool = False,
    width: int | None = None,
    file: IO[str] | None = None,
    force_terminal: bool | None = None,
    markup: bool = False,
) -> Console:
    """Return a console that prints texts unchanged: `[fe80::a:b:1]` holds neither markup nor emoji, numbers have no colours."""
    return Console(
        stderr=stderr, soft_wrap=soft_wrap, width=width, file=file, force_terminal=force_terminal, highlight=False,
        emoji=False, markup=markup,
    )  # fmt: skip
