"""Before a session is run: warnings in `advise`'s words on standard error, and the refusal of what is known to be unstable.

Hardware is never held in what is refused: `--allow-unstable` is for simulated, emulated and replayed devices.
"""

from collections.abc import Iterable, Mapping
from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.terminal.console import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import say
from cogrip.devices.device import DeviceError
from cogrip.devices.registry import FAMILIES, is_real
from cogrip.protocol.settings import Settings
from cogrip.sim.analysis.advice import Finding, advise, ample, overloads
from cogrip.sim.analysis.lifted_model import LiftedModel
from cogrip.sim.analysis.linear_session import ModelError, linear_session
from cogrip.sim.analysis.plausible import implausible
from cogrip.sim.analysis.stability import modes

AllowUnstable = Annotated[
    bool,
    Parameter(
        name="--allow-unstable",
        negative="",
        help="Run what `cogrip advise` says is not stable, or more than a device carries. Never with hardware.",
    ),
]
ALLOW = "; --allow-unstable runs it all the same"
HELD_BY_NOBODY = ("sim:", "emulated:", "replay:")  # no person's hand is in these
MOST_STATES = 256  # of a model that is advised with before a run: its work goes with the cube, 2 s at this


def check_settings(settings: Settings, allow_unstable: bool = False, also: tuple[str, ...] = ()) -> None:
    """Warn of all that there is to warn of, then refuse. Raises BadInput.

    also: more reasons to refuse than the settings give, each with the value that would do.
    """
    check_plausible(settings)
    try:
        warnings, refused = advice_on(settings)
    except DeviceError as error:
        raise BadInput(str(error)) from None
    names = [user.name for user in settings.users]
    first = "" if allow_unstable else next(iter(together((*also, *refused), names)), "")
    warn([text for text in together((*warnings, *also), names) if text != first])
    if first:
        raise BadInput(f"refused: {first}{ALLOW}")


def together(texts: Iterable[str], names: Iterable[str]) -> list[str]:
    """Return each text once: what is said of several people in the same words is said of all of them at once."""
    known, who = set(names), dict[str, list[str]]()
    for text in dict.fromkeys(texts):
        name, colon, words = text.partition(": ")
        who.setdefault(words if colon and name in known else text, []).extend([name] if colon and name in known else [])
    return [f"{', '.join(people)}: {words}" if people else words for words, people in who.items()]


def check_compared(sessions: Mapping[str, Settings], allow_unstable: bool = False) -> None:
    """The same for sessions that are run side by side, by name. Raises BadInput.

    Methods are compared where they are unstable, too: only what a device does not carry is refused.
    """
    said: dict[str, list[str]] = {}
    for name, settings in sessions.items():
        warnings, _ = advice_on(settings)
        for text in together(warnings, [user.name for user in settings.users]):
            said.setdefault(text, []).append(name)
    all_of = ((settings, [user.name for user in settings.users]) for settings in sessions.values())
    refused = next((text for settings, names in all_of for text in together(overloads(settings), names)), "")
    first = "" if allow_unstable else refused
    warn([f"{', '.join(names)}: {text}" for text, names in said.items() if text != first])
    if first:
        raise BadInput(f"refused: {first}{ALLOW}")


def check_plausible(settings: Settings) -> None:
    """Warn of inputs that are unlikely; raises BadInput for one that cannot be meant."""
    try:
        found = implausible(settings)
    except DeviceError as error:
        raise BadInput(str(error)) from None
    tell_implausible(found)


def tell_implausible(found: Iterable[Finding]) -> None:
    """Raises BadInput for what cannot be meant."""
    found = list(found)
    warn([finding.text for finding in found if not finding.refused])
    if refused := [finding.text for finding in found if finding.refused]:
        raise BadInput(f"refused: {refused[0]}")


def advice_on(settings: Settings) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(warnings, refusals among them) of `advise`, as far as there is a model that does not take too long.

    The refusal with the least value comes first. Raises DeviceError.
    """
    refused = overloads(settings)
    try:
        model = LiftedModel(linear_session(settings))
        states = max(part.model.states for part in modes(model))
        if states > MOST_STATES:
            raise ModelError(f"a model of {states} states takes too long here; `cogrip advise` takes its time")
        advice = advise(settings, ample)
    except (ArithmeticError, ValueError) as error:  # ModelError and LinAlgError are ValueErrors
        return (*refused, f"no advice on stability: {error}"), refused
    return advice.warnings, (*refused, *(text for text in advice.refusals if text not in refused))


def warn(texts: Iterable[str]) -> None:
    errors = make_console(stderr=True, soft_wrap=True)
    for text in texts:
        say(errors, f"warning: {text}")


def refuse_hardware(addresses: Iterable[str]) -> None:
    """Raises BadInput where `--allow-unstable` is asked for with hardware, or what may be: a driver of another package."""
    for address in addresses:
        try:
            real = is_real(address) or address.partition(":")[0] not in FAMILIES
        except DeviceError as error:
            raise BadInput(str(error)) from None
        if real:
            raise BadInput(
                f"--allow-unstable: {address} is hardware, in somebody's hand, and settings may be another's: "
                "it is held with no more than it carries; leave the flag out, or take sim: or emulated:"
            )
