"""A person's `device` in the text of a settings file, and the impedance that it carries; all else left as it stands."""

import json
import re
import tomllib
from math import inf
from typing import Any

from cogrip.cli.settings.shipped_settings import shipped
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.settings.coupling import CouplingSection as Coupling

START = "demo"
_USERS = re.compile(r"\s*\[\[\s*users\s*\]\]\s*(#.*)?")
_TABLE = re.compile(r"\s*\[")
_KEY = re.compile(r"\s*([a-z_]+)\s*=")
IMPEDANCE = "impedance_nspm"


def starting_text() -> str:
    """Return the settings that a new file begins with."""
    return shipped(START).read_text(encoding="utf-8")


def placed(text: str, name: str, address: str, where: str, carried_nspm: float = inf) -> tuple[str, str, float | None]:
    """Return the text with the device of the person called `name` (the first for "") replaced, and the person's name.

    carried_nspm: largest impedance that the device carries [N s/m]; where the settings ask for more, this person's own is
    written too, and returned as the third; None where it is not. Raises BadInput where the text is no settings, has no such
    person, or does not write people as [[users]].
    """
    people = _people(text, where)
    names = [str(person.get("name", "")) for person in people]
    if not people or (name and name not in names):
        raise BadInput(f"{where}: has no user {name!r}; there is: {', '.join(names) or 'none'}")
    number = names.index(name) if name else 0
    own = _fitting(text, people[number], carried_nspm)
    values: dict[str, Any] = {"device": address} | ({} if own is None else {IMPEDANCE: own})
    lines = text.splitlines(keepends=True)
    heads = [at for at, line in enumerate(lines) if _USERS.fullmatch(line.rstrip("\r\n"))]
    if number < len(heads):
        begin = heads[number] + 1
        for key, value in reversed(values.items()):
            end = next((at for at in range(begin, len(lines)) if _TABLE.match(lines[at])), len(lines))
            line = f"{key} = {json.dumps(value)}\n"
            old = [at for at in range(begin, end) if (found := _KEY.match(lines[at])) and found[1] == key]
            lines[old[0] if old else begin : old[0] + 1 if old else begin] = [line]
    new = "".join(lines)
    wanted = [dict(person) for person in people]
    wanted[number].update(values)
    try:
        good = _people(new, where) == wanted
    except BadInput:
        good = False
    if not good:
        told = ", ".join(f"{key} = {json.dumps(value)}" for key, value in values.items())
        raise BadInput(f"{where}: write it yourself, below [[users]] of {names[number]}: {told}")
    return new, names[number], own


def _fitting(text: str, person: dict[str, Any], carried_nspm: float) -> float | None:
    """Return the impedance that this person must have of their own, None where that of the settings will do."""
    coupling = tomllib.loads(text).get("coupling", {})
    usual = coupling.get(IMPEDANCE, Coupling().impedance_nspm) if isinstance(coupling, dict) else None
    asked = person.get(IMPEDANCE, usual)
    if not isinstance(asked, int | float) or asked <= carried_nspm:
        return None
    return float(f"{carried_nspm - 0.005 * carried_nspm:.2g}")


def _people(text: str, where: str) -> list[dict[str, Any]]:
    try:
        users = tomllib.loads(text).get("users", [])
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"{where}: not valid TOML: {error}; mend it, or name another file") from None
    return [user for user in users if isinstance(user, dict)] if isinstance(users, list) else []
