"""Consoles: texts are printed unchanged, and one factory makes all consoles."""

import io
import re
from pathlib import Path

import pytest

from cogrip.cli.terminal.output import make_console

CLI = Path(__file__).resolve().parents[2] / "cli" / "cogrip" / "cli"
PLACE = "output.py"


@pytest.mark.parametrize("text", ["[fe80::a:b:100:1]:4000", "serial:/dev/x:o:y", ":smile: 0x1f 12"])
def test_nothing_becomes_an_emoji_or_a_colour(text: str) -> None:
    file = io.StringIO()
    make_console(file=file, force_terminal=True, soft_wrap=True).print(text, markup=False)
    assert file.getvalue() == f"{text}\n"


def test_every_console_is_made_in_one_place() -> None:
    made = re.compile(r"\bConsole\((?!.*emoji=False)")
    elsewhere = [
        path.name for path in sorted(CLI.rglob("*.py")) if path.name != PLACE and made.search(path.read_text())
    ]
    assert elsewhere == []
