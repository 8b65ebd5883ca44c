"""A person's `device` in the text of a settings file, all else of it left as it stands."""

import json
import re
import tomllib
from typing import Any

from cogrip.cli.session.shipped_settings import shipped
from cogrip.cli.terminal.problem import BadInput

START = "demo"
_USERS = re.compile(r"\s*\[\[\s*users\s*\]\]\s*(#.*)?")
_TABLE = re.compile(r"\s*\[")
_DEVICE = re.compile(r"\s*device\s*=")


def starting_text() -> str:
    """Return the settings that a new file begins with."""
    return shipped(START).read_text(encoding="utf-8")


def placed(text: str, name: str, address: str, where: str) -> tuple[str, str]:
    """Return the text with the device of the person called `name` (the first for "") replaced, and the person's name.

    Raises BadInput where the text is no settings, has no such person, or does not write people as [[users]].
    """
    people = _people(text, where)
    names = [str(person.get("name", "")) for person in people]
    if not people or (name and name not in names):
        raise BadInput(f"{where}: has no user {name!r}; there is: {', '.join(names) or 'none'}")
    number = names.index(name) if name else 0
    lines = text.splitlines(keepends=True)
    heads = [at for at, line in enumerate(lines) if _USERS.fullmatch(line.rstrip("\r\n"))]
    if number < len(heads):
        begin = heads[number] + 1
        end = next((at for at in range(begin, len(lines)) if _TABLE.match(lines[at])), len(lines))
        line = f"device = {json.dumps(address)}\n"
        old = [at for at in range(begin, end) if _DEVICE.match(lines[at])]
        lines[old[0] if old else begin : old[0] + 1 if old else begin] = [line]
    new = "".join(lines)
    wanted = [dict(person) for person in people]
    wanted[number]["device"] = address
    try:
        good = _people(new, where) == wanted
    except BadInput:
        good = False
    if not good:
        raise BadInput(
            f"{where}: write it yourself, below [[users]] of {names[number]}: device = {json.dumps(address)}"
        )
    return new, names[number]


def _people(text: str, where: str) -> list[dict[str, Any]]:
    try:
        users = tomllib.loads(text).get("users", [])
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"{where}: not valid TOML: {error}; mend it, or name another file") from None
    return [user for user in users if isinstance(user, dict)] if isinstance(users, list) else []
