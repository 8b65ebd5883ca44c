"""Errors of command lines in the style of all other errors: the name, the expected value, the given one."""

import difflib
from typing import Any, Literal, get_args, get_origin

from cyclopts import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)  # fmt: skip

from cogrip.protocol.settings.errors import expects
from cogrip.protocol.wire.join_link import is_link, is_secret

SECRET = "a join link"
_KINDS = {float: "a number", int: "a whole number", bool: "true or false"}


def words_of(error: CycloptsError, commands: tuple[str, ...] = ()) -> str:
    """Return the error in one line. commands: those that can stand in place of an unknown one."""
    command = " ".join(error.command_chain or ())
    where = f"{command}: " if command else ""
    cure = f"; `cogrip {command} --help` lists them" if command else "; `cogrip --help` lists them"
    if isinstance(error, CoercionError) and error.token is not None:
        return _coerced(error, error.token)
    if isinstance(error, UnknownOptionError):
        near = _nearest(error.token.keyword or error.token.value, _options(error))
        return f"{where}there is no option {error.token.keyword or error.token.value}{near or cure}"
    if isinstance(error, UnknownCommandError) and error.unused_tokens:
        known, given = _commands(error) or commands, error.unused_tokens[0]
        what = "option" if given.startswith("-") else "command"
        return f"{where}there is no {what} {_shown(given)}{_nearest(given, known)}; there are: {', '.join(known)}"
    see = f"; `cogrip {command} --help` shows what it takes"
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        return f"{where}{_shown(error.unused_tokens[0])} is one word too many{see}"
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        name, lacks = (error.keyword, "needs a value") if error.keyword else (error.argument.name, "is missing")
        return f"{where}{name} {lacks}{see}"
    return f"{where}{error}"


def _coerced(error: CoercionError, token: Any) -> str:
    names = error.argument.names if error.argument is not None else ()
    name = token.keyword or next(iter(names), "argument")
    if len(name.lstrip("-")) == 1:  # -m says no unit, --minutes does
        name = next((long for long in names if len(long.lstrip("-")) > 1), name)
    kind, given = error.target_type, token.value
    if _shown(given) is SECRET:
        return f"{name}: expects another value than {SECRET}"
    if get_origin(kind) is Literal:
        choices = [f'"{choice}"' for choice in get_args(kind)]
        what = f"{', '.join(choices[:-1])} or {choices[-1]}" if choices[1:] else choices[0]
        return f"{expects(name, what, token.value)}{_nearest(token.value, get_args(kind))}"
    return expects(name, _KINDS.get(kind, getattr(kind, "__name__", "another value")), token.value)  # type: ignore[arg-type]


def _shown(word: str) -> str:
    """Return a word as it may stand in an error: whoever reads a join link may join."""
    return SECRET if is_link(word) or is_secret(word) else repr(word)


def _options(error: CycloptsError) -> tuple[str, ...]:
    """Return the options of the command that was meant."""
    arguments = getattr(error, "argument_collection", None) or ()
    return tuple(name for argument in arguments for name in argument.names if name.startswith("--"))


def _commands(error: CycloptsError) -> tuple[str, ...]:
    app: Any = error.app
    while isinstance(app, (list, tuple)):
        app = app[-1] if app else None
    return tuple(name for name in app if not name.startswith("-")) if app is not None else ()


def _nearest(given: str, known: Any) -> str:
    near = difflib.get_close_matches(given, [str(each) for each in known], n=1, cutoff=0.6)
    return f"; did you mean {near[0]}?" if near else ""
