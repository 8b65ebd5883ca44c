"""Before a session is run: warnings in `advise`'s words on standard error, and the refusal of what is known to be unstable.

Hardware is never held in what is refused: `--allow-unstable` is for simulated, emulated and replayed devices.
"""

from collections.abc import Iterable
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.problem import BadInput
from cogrip.devices.device import DeviceError
from cogrip.devices.registry import FAMILIES, is_real
from cogrip.protocol.settings import Settings
from cogrip.sim.analysis.advice import advise, ample, overloads
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
    errors = Console(stderr=True, highlight=False, soft_wrap=True)
    refuse_hardware([user.device for user in settings.users] if allow_unstable else [])
    try:
        unlikely = implausible(settings)
        warnings, refused = advice_on(settings)
    except DeviceError as error:
        raise BadInput(str(error)) from None
    refused = (*also, *refused)
    first = [] if allow_unstable else refused[:1]
    warn(errors, [finding.text for finding in unlikely if not finding.refused])
    warn(errors, [text for text in dict.fromkeys((*warnings, *also)) if text not in first])
    if impossible := [finding.text for finding in unlikely if finding.refused]:
        raise BadInput(f"refused: {impossible[0]}")
    if first:
        raise BadInput(f"refused: {first[0]}{ALLOW}")


def advice_on(settings: Settings) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(warnings, refusals among them) of `advise`, as far as there is a model that does not take too long.

    The refusal with the least value comes first. Raises DeviceError.
    """
    refused = overloads(settings)
    try:
        model = LiftedModel(linear_session(settings, estimated=True))
        states = max(part.model.states for part in modes(model))
        if states > MOST_STATES:
            raise ModelError(f"a model of {states} states takes too long here; `cogrip advise` takes its time")
        advice = advise(settings, ample)
    except (ArithmeticError, ValueError) as error:  # ModelError and LinAlgError are ValueErrors
        return (*refused, f"no advice on stability: {error}"), refused
    return advice.warnings, (*refused, *(text for text in advice.refusals if text not in refused))


def warn(errors: Console, texts: Iterable[str]) -> None:
    for text in texts:
        errors.print(f"warning: {text}", markup=False)


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
