"""`cogrip advise`: what to know of a session before anyone holds a device."""

from pathlib import Path
from typing import Any

from rich.console import Console

from cogrip.cli.json_answer import Json, write_json
from cogrip.cli.problem import BadInput
from cogrip.cli.question import Devices, Overrides, Question
from cogrip.cli.settings_file import load, with_people
from cogrip.devices.device import DeviceError
from cogrip.protocol.settings import Settings
from cogrip.sim.analysis.advice import Advice, advise
from cogrip.sim.analysis.advice_change import Change, best_change
from cogrip.sim.analysis.delay_budget import Stage, budget, total_s
from cogrip.sim.analysis.linear_session import LinearSession, ModelError, linear_session


def advise_command(config: Path, /, *, overrides: Overrides = (), device: Devices = (), json: Json = None) -> int:
    """Say before anyone holds a device: stable or not, by what margin; passive or not; what hands feel; what would help.

    Computed from the lifted model, with free hands, each device's own velocity estimate, and the link's constant
    delays; jitter, loss, friction and encoder steps are left out. Exit code 0 whatever the advice.

    Parameters
    ----------
    config
        Settings file, or the name of one that comes with cogrip (`cogrip configs`).
    device
        Device address of the first, second ... person in place of the settings'. Repeatable.
    """
    settings = with_people(load(config, overrides), (), device)
    try:
        advice = advise(settings)
        session = linear_session(settings, estimated=True)
        change = _change(settings, advice)
    except (ModelError, DeviceError) as error:
        raise BadInput(f"{config}: {error}") from None
    Question.tell_rounding(session)
    if json:
        write_json(_record(advice, session, change), json)
        return 0
    console = Console(highlight=False, soft_wrap=True)
    for finding in advice.findings:
        console.print(f"{finding.level:8}{finding.topic:11}{finding.text}", markup=False)
    budgets: dict[tuple[Stage, ...], list[str]] = {}
    for number, person in enumerate(session.people):
        budgets.setdefault(budget(session, number), []).append(person.name)
    for stages, names in budgets.items():
        told = ", ".join(f"{stage.way} {stage.name} {1e3 * stage.delay_s:.1f}" for stage in stages if stage.delay_s)
        text = f"{', '.join(names)}: {1e3 * total_s(stages):.1f} ms round: {told}"
        console.print(f"{'':8}{'delay':11}{text}", markup=False)
    if change:
        console.print(f"most helpful: --set {change.setting}: {change.effect}", markup=False)
    else:
        console.print("most helpful: nothing of what was tried would be better")
    return 0


def _change(settings: Settings, advice: Advice) -> Change | None:
    """What helps most; on a terminal, how far the search is: of many people far apart it takes a while."""
    errors = Console(stderr=True, highlight=False)
    with errors.status("looking for what would help") as status:
        return best_change(
            settings,
            advice,
            lambda tried, total: status.update(f"looking for what would help: {tried} of {total} tried"),
        )


def _record(advice: Advice, session: LinearSession, change: Change | None) -> dict[str, Any]:
    return {
        "scheme": advice.verdict.scheme,
        "stable": advice.verdict.stable,
        "spectral_radius": advice.verdict.spectral_radius,
        "radius_without_structural": advice.verdict.decaying,
        "largest_stable_stiffness_npm": advice.limit.stiffness_npm,
        "stiffness_npm": advice.stiffness_npm,
        "users": [
            {
                "name": user.name,
                "asked_stiffness_npm": user.asked_npm,
                "felt_stiffness_npm": user.felt_npm,
                "compensated_stiffness_npm": user.compensated_npm,
                "enough_impedance_nspm": user.enough_impedance_nspm,
                "b_tc_over_m": user.b_tc_over_m,
                "advised_damping_nspm": user.advised_damping_nspm,
                "largest_impedance_nspm": user.largest_impedance_nspm,
                "impedance_bound": user.impedance_bound,
                "delay_ms": {f"{stage.way} {stage.name}": 1e3 * stage.delay_s for stage in budget(session, number)},
            }
            for number, user in enumerate(advice.users)
        ],
        "findings": [
            {"topic": finding.topic, "level": finding.level, "text": finding.text} for finding in advice.findings
        ],
        "warnings": list(advice.warnings),
        "change": {"set": change.setting, "effect": change.effect} if change else None,
    }
