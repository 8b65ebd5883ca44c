"""Checks before a session is run: warnings in `advise`'s words on standard error, and the refusal of unstable settings.

A person never holds hardware in a refused session: `--allow-unstable` is for simulated, emulated and replayed devices.
"""

from collections.abc import Iterable, Mapping
from typing import Annotated

from cyclopts import Parameter

from cogrip.analysis.advice.advice import advise, ample, overloads, unbounded
from cogrip.analysis.advice.finding import Finding
from cogrip.analysis.advice.partner_advice import partner_warnings
from cogrip.analysis.advice.plausible import implausible
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import ModelError, linear_session
from cogrip.analysis.linear.stability import modes
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import say
from cogrip.devices.device import DeviceError
from cogrip.devices.registry import FAMILIES, is_real
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.settings.sections import Settings

AllowUnstable = Annotated[
    bool,
    Parameter(
        name="--allow-unstable",
        negative="",
        help="Run a session that `cogrip advise` calls unstable, or that exceeds a device's record. Never with hardware.",
    ),
]
ALLOW = "; --allow-unstable runs it all the same"
HELD_BY_NOBODY = ("sim:", "emulated:", "replay:")  # schemes of devices that no person holds
MOST_STATES = 256  # most states of a model that is advised with before a run: its work grows with the cube, 2 s at this


def check_settings(
    settings: Settings, allow_unstable: bool = False, also: tuple[str, ...] = (), where: str = ""
) -> list[str]:
    """Print all warnings, then refuse; return them as they were printed. Raises BadInput.

    also: more reasons to refuse than the settings give, each with its cure. where: stands before each.
    """
    told = check_plausible(settings, where)
    with BadInput.of(DeviceError):
        warnings, refused = advice_on(settings)
    names = [user.name for user in settings.users]
    first = "" if allow_unstable else next(iter(together((*also, *refused), names)), "")
    told += warn([f"{where}{text}" for text in together((*warnings, *also), names) if text != first])
    if first:
        raise BadInput(f"{where}refused: {first}{ALLOW}")
    return told


def together(texts: Iterable[str], names: Iterable[str]) -> list[str]:
    """Return each text once, behind the names of all people of whom it is said."""
    known, who = set(names), dict[str, list[str]]()
    for text in dict.fromkeys(texts):
        name, colon, words = text.partition(": ")
        who.setdefault(words if colon and name in known else text, []).extend([name] if colon and name in known else [])
    return [f"{', '.join(people)}: {words}" if people else words for words, people in who.items()]


def check_compared(sessions: Mapping[str, Settings], allow_unstable: bool = False) -> None:
    """Do as `check_settings` for sessions that are compared, by name. Raises BadInput.

    Unstable methods are compared, too: only what exceeds a device's record is refused.
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


def check_plausible(settings: Settings, where: str = "") -> list[str]:
    """Warn of unlikely inputs, and return that; raise BadInput for an implausible one. where: stands before each."""
    with BadInput.of(DeviceError):
        found = implausible(settings)
    return refuse_implausible(found, where)


def refuse_implausible(found: Iterable[Finding], where: str = "") -> list[str]:
    """Warn of unlikely inputs that were found, and return that; raise BadInput for an implausible one.

    where: stands before each
    """
    found = list(found)
    told = warn([f"{where}{finding.text}" for finding in found if not finding.refused])
    if refused := [finding.text for finding in found if finding.refused]:
        raise BadInput(f"{where}refused: {refused[0]}")
    return told


def advice_on(settings: Settings) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return (warnings, refusals among them) of `advise`, where there is a model that does not take too long.

    The refusal with the least value comes first. Raises DeviceError.
    """
    refused = overloads(settings)
    if not kind_of(settings.object.kind).plain:  # no model
        refused += (*unbounded(settings), *_makes_energy(settings))
        return tuple(dict.fromkeys((*refused, *scene_warnings(settings)))), refused
    if settings.coupling.traits.gated:
        return partner_warnings(settings), refused
    try:
        model = LiftedModel(linear_session(settings))
        states = max(part.model.states for part in modes(model))
        if states > MOST_STATES:
            raise ModelError(f"a model of {states} states takes too long here; `cogrip advise` takes its time")
        advice = advise(settings, ample)
    except (ArithmeticError, ValueError) as error:  # ModelError and LinAlgError are ValueErrors
        return (*refused, f"no advice on stability: {error}"), refused
    return advice.warnings, (*refused, *(text for text in advice.refusals if text not in refused))


def _makes_energy(settings: Settings) -> tuple[str, ...]:
    """Return why a scene is refused that sets contact of its own, and makes energy in a few pushes."""
    if not settings.object.traits.scene:
        return ()
    from cogrip.analysis.advice.scene_pushed import FEW, pushed, sets_contact  # with MuJoCo

    with BadInput.of(ValueError):  # a SceneError
        if not sets_contact(settings):
            return ()
        found = pushed(settings, FEW)
    return (found.text,) if found.refused else ()


def scene_warnings(settings: Settings) -> tuple[str, ...]:
    """Return what `cogrip advise` warns of in a scene, of which there is no linear model; nothing of other objects."""
    if not settings.object.traits.scene:
        return ()
    from cogrip.analysis.advice.scene_advice import scene_findings  # with MuJoCo

    with BadInput.of(ValueError):  # a SceneError
        return tuple(finding.text for finding in scene_findings(settings) if finding.warns)


def scene_notes(settings: Settings) -> tuple[str, ...]:
    """Return what those who hold or look at a scene are told of it; nothing of other objects. Raises BadInput."""
    if not settings.object.traits.scene:
        return ()
    from cogrip.server.schemes import make_scene_world  # with MuJoCo

    with BadInput.of(ValueError):  # a SceneError
        world = make_scene_world(settings, [seat_settings(settings, seat) for seat in range(len(settings.users))])
        return tuple(world.drawing.notes())


def tell_scene(settings: Settings) -> None:
    """Print on standard error what is not drawn, not used or changed of a scene. Raises BadInput."""
    errors = make_console(stderr=True, soft_wrap=True)
    for text in scene_notes(settings):
        say(errors, f"note: {text}")


def warn(texts: Iterable[str]) -> list[str]:
    """Print warnings on standard error, and return the lines."""
    errors, lines = make_console(stderr=True, soft_wrap=True), [f"warning: {text}" for text in texts]
    for line in lines:
        say(errors, line)
    return lines


def refuse_hardware(addresses: Iterable[str]) -> None:
    """Raise BadInput where `--allow-unstable` is given with hardware, or with a driver of another package, which may be."""
    for address in addresses:
        with BadInput.of(DeviceError):
            real = is_real(address) or address.partition(":")[0] not in FAMILIES
        if real:
            raise BadInput(
                f"--allow-unstable: {address} is hardware, which a person holds, and settings may be another's: its record "
                "is never exceeded; leave the flag out, or take sim: or emulated:"
            )
