"""The pages that tests hold the code against: a section of SPEC.md, the rows of a table."""

import re
from pathlib import Path

HERE = Path(__file__).parents[2]
SPEC = (HERE / "protocol" / "SPEC.md").read_text(encoding="utf-8")
SECURITY = (HERE / "docs" / "security.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    """The text under a heading, to the next heading."""
    found = re.search(rf"^#+ {re.escape(title)}.*?\n(.*?)(?=^#+ |\Z)", SPEC, re.MULTILINE | re.DOTALL)
    assert found, title
    return found[1]


def rows(text: str, first: str) -> list[list[str]]:
    """The cells of the first table whose header begins with `first`."""
    lines = text.splitlines()
    start = next(number for number, one in enumerate(lines) if one.startswith(f"| {first} |"))
    table = []
    for one in lines[start + 2 :]:
        if not one.startswith("|"):
            break
        table.append([cell.strip() for cell in one.strip().strip("|").split("|")])
    return table
