"""Error texts on the allowed values of a setting, a key of a device address or a flag, in one style.

coupling.stiffness_npm: expects a number of at least 0, in N/m; got '500N/m'
"""

import re
from typing import Any

UNITS = {
    "rad_s": "rad/s", "nspm": "N s/m", "npm": "N/m", "mps": "m/s", "nps": "N/s", "kbps": "kbit/s", "ms": "ms", "mj": "mJ",
    "hz": "Hz", "kg": "kg", "s": "s", "m": "m", "n": "N", "j": "J", "w": "W",
    "seconds": "s", "minutes": "min",
}  # fmt: skip
"""Unit of a setting, by the end of its name; the first that fits counts."""

_KINDS = {
    "float": "a number", "int": "a whole number", "bool": "true or false", "str": "a text", "array": "a list",
    "object": "a table",
}  # fmt: skip
_BOUNDS = {">=": "of at least", "<=": "of at most", ">": "above", "<": "below"}
_MSGSPEC = re.compile(
    r"Expected `?(?P<kind>float|int|bool|str|array|object)(?: \| null)?`?(?P<length> of length)?"
    r"(?: (?P<sign>[<>]=?))?(?: ?(?P<bound>\d\S*))?(?:, got .*)?"
)


def unit_of(name: str) -> str:
    """Return the unit in a name, "" where it has none."""
    last = re.sub(r"(\.\d+)+$", "", name).replace("-", "_").rpartition(".")[2]
    return next((unit for end, unit in UNITS.items() if last == end or last.endswith(f"_{end}")), "")


def expects(name: str, what: str, got: Any) -> str:
    """Return the whole sentence. what: such as "a number above 0"; numbers get the unit of the name."""
    unit = unit_of(name)
    said = f", in {unit}" if unit and " number" in what else ""
    return f"{name}: expects {what}{said}; got {got!r}"


def plain(message: str) -> str:
    """Return msgspec's expectation as "a number of at least 0"; "" for a message on something else."""
    found = _MSGSPEC.fullmatch(message)
    if found is None:
        return ""
    kind, bound = _KINDS[found["kind"]], f"{float(found['bound']):.10g}" if found["bound"] else ""
    bounded = f"{_BOUNDS[found['sign']]} {bound}" if found["sign"] else bound
    if found["length"]:
        return f"{kind} of length {bounded.removeprefix('of ')}"
    return f"{kind} {bounded}".strip()
