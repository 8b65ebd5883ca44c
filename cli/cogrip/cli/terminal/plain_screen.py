"""The screen of a terminal without job control: lines only, and no live table."""

from collections.abc import Callable
from typing import Self

from rich.console import Console, RenderableType


def may_draw(console: Console) -> bool:
    """Return False."""
    return False


class LiveScreen:
    """Context in which `say` passes lines to `directly`."""

    def __init__(self, directly: Callable[[str], None]) -> None:
        self.say = directly

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *ending: object) -> None:
        self.close()

    def draw(self, module: str, argument: str) -> None:
        """Draw nothing."""

    def passed(self, lines: str) -> bool:
        """Return False: no drawing takes lines."""
        return False

    def close(self) -> None:
        """Do nothing."""


def draw_below(table: Callable[[int, int], RenderableType]) -> None:
    """Draw nothing."""
