"""`cogrip advise`: advice on a session before anyone holds a device."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from cogrip.analysis.advice.advice import AMPLE, Advice, advise
from cogrip.analysis.advice.advice_change import Change, ranked_changes
from cogrip.analysis.advice.delay_budget import Stage, budget, total_s
from cogrip.analysis.advice.finding import Finding, in_rows, plain
from cogrip.analysis.advice.laboratory_check import Check, check, checked_change, checked_stiffest
from cogrip.analysis.advice.line_advice import own_world_findings
from cogrip.analysis.advice.partner_advice import partner_findings
from cogrip.analysis.advice.stiffest import NEARLY, Stiffest, stiffest
from cogrip.analysis.linear.linear_session import LinearSession, ModelError, linear_session
from cogrip.cli.session.python_worlds import PythonWorlds, allow_python_worlds
from cogrip.cli.settings.settings_file import load, with_people
from cogrip.cli.study.analysis_query import AS_IT_STANDS, Query
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.parameters import Config, Devices, Overrides
from cogrip.cli.terminal.problem import BadInput
from cogrip.devices.device import DeviceError
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.sections import Settings


def advise_command(
    config: Config,
    /,
    *,
    for_stiffness: bool = False,
    laboratory: bool = True,
    overrides: Overrides = (),
    device: Devices = (),
    python_worlds: PythonWorlds = (),
    json: Json = None,
) -> int:
    """Advise on stability, feel and improvements before anyone holds a device.

    Stable or not, with its margin; passive or not; what hands feel; the most helpful change. Computed from the lifted model,
    with free devices, each client's own velocity estimate, and the link's constant delays; then checked by sessions in
    virtual time, with the link's jitter and loss. Exit code 0 whatever the advice.

    Parameters
    ----------
    for_stiffness
        Instead find the stiffest contact that can be felt with these devices over this link, and its b and K.
    laboratory
        Check the advice by sessions in virtual time: some seconds; `--no-laboratory` leaves that out.
    """
    allow_python_worlds(python_worlds)
    settings = with_people(load(config, overrides), (), device)
    with BadInput.of(ModelError, DeviceError, where=f"{config}: "):
        modelled = kind_of(settings.object.kind).plain and not settings.coupling.traits.gated
        if not modelled and not for_stiffness:
            return _without_model(settings, laboratory, json)
        if for_stiffness:
            return _print_stiffest(config, settings, laboratory, json)
        advice = advise(settings)
        session = linear_session(settings)
        checked = _watched("running sessions in virtual time", lambda _: check(settings)) if laboratory else None
        change = _change(settings, advice, checked)
    Query.tell_rounding(session)
    if json:
        write_json(_record(advice, session, change, checked), json)
        return 0
    names = [user.name for user in settings.users]
    rows = _rows([*advice.findings, *_seen(checked)], names)
    budgets: dict[tuple[Stage, ...], list[str]] = {}
    for number, person in enumerate(session.people):
        budgets.setdefault(budget(session, number), []).append(person.name)
    for stages, alike in budgets.items():
        parts = ", ".join(f"{each.direction} {each.name} {1e3 * each.delay_s:.1f}" for each in stages if each.delay_s)
        rows.append(("", "delay", f"{', '.join(alike)}: {1e3 * total_s(stages):.1f} ms round: {parts}"))
    laboratory_too = "; the laboratory sessions have jitter, loss and simulated hands" if checked else ""
    rows.append(("", "conditions", f"{AS_IT_STANDS.conditions}{laboratory_too}"))
    confirmed = checked and (not change or change.measured)
    by = " (confirmed by sessions in virtual time)" if confirmed else " (by the model alone)"
    if change:
        last = f"most helpful{by}: --set {change.setting}: {change.effect}"
    else:
        last = f"most helpful: nothing of what was tried would be better{by}"
    _print(rows, last)
    return 0


def _without_model(settings: Settings, laboratory: bool, json: Json) -> int:
    """Advise on a scene, a world of one's own, or partners' models: what can be said of each, and what a session shows."""
    with BadInput.of(ValueError):  # a SceneError
        if settings.object.traits.scene:
            from cogrip.analysis.advice.scene_advice import scene_findings  # with MuJoCo
            from cogrip.analysis.advice.scene_pushed import pushed

            gated = settings.coupling.traits.gated
            findings = [*scene_findings(settings), *(partner_findings(settings) if gated else [pushed(settings)])]
            findings = list(dict.fromkeys(findings))
        elif settings.coupling.traits.gated:
            findings = partner_findings(settings)
        else:
            findings = list(own_world_findings(settings))
        refused = any(finding.refused for finding in findings)
        checked = None
        if laboratory and not refused:
            checked = _watched("running a session in virtual time", lambda _: check(settings))
            findings.append(checked.session)
    if json:
        warnings = [finding.text for finding in findings if finding.warns]
        write_json({"findings": _told(findings), "warnings": warnings, "laboratory": _judged(checked)}, json)
    else:
        rows = _rows(findings, [user.name for user in settings.users])
        _print(rows, "most helpful: not looked for, as there is no linear model of this session to rank changes by")
    return 0


def _print_stiffest(config: Path, settings: Settings, laboratory: bool, json: Json) -> int:
    def look(progress: Callable[[int, int], None]) -> tuple[Stiffest, Check | None] | None:
        if laboratory:
            return checked_stiffest(settings, progress)
        found = stiffest(settings, progress)
        return (found, None) if found else None

    answer: tuple[Stiffest, Check | None] | None = _watched("looking for the stiffest", look)
    if answer is None:
        sessions = ", and a session in virtual time confirms it" if laboratory else ""
        raise BadInput(f"{config}: no b and K within the devices' records was found for which this is stable{sessions}")
    found, checked = answer
    if json:
        write_json({"stiffest": _stiffest_record(found, checked)}, json)
        return 0
    people = [user.name for user in settings.users]
    most = found.limit.stiffness_npm
    reasons = {
        "stability": f"K stays {AMPLE:g} times below {plain(most or 0.0)} N/m, up to which the session is stable",
        "the line": f"K is so large that {100.0 * NEARLY:g} % of the stiffness that the line transmits is felt",
        "sessions": "with a larger b or K a session in virtual time was not passive and stable",
        "the device's record": "more is felt than the device's record advises with a larger K or b",
    }
    felt = " and ".join(dict.fromkeys(plain(user.felt_npm) for user in found.advice.users))
    shown = [finding for finding in found.advice.findings if finding.topic in ("device", "free motion")]
    rows = [
        ("", "stiffest", f"{_in_sessions(checked)}{felt} N/m felt at rest, calculated without jitter and loss"),
        ("", "settings", " ".join(f"--set {Change.written(key, value)}" for key, value in found.overrides.items())),
        ("", "bound", reasons[found.bounded]),
        *_rows([*shown, *_seen(checked, {user.name: user.felt_npm for user in found.advice.users})], people),
    ]
    _print(rows, "")
    return 0


TableRow = tuple[str, str, str]


def _seen(checked: Check | None, expected_npm: Mapping[str, float] | None = None) -> list[Finding]:
    return [checked.session, *checked.felt(expected_npm)] if checked else []


def _rows(findings: Iterable[Finding], people: Sequence[str]) -> list[TableRow]:
    """Return a row a finding; people with the same finding share one."""
    return [
        (level, topic, f"{', '.join(names)}: {text}" if any(names) else text)
        for (level, topic, text), names in in_rows(findings, people).items()
    ]


def _print(rows: Iterable[TableRow], last: str) -> None:
    """Print level, topic and text in columns, the text wrapped within its own."""
    console = make_console()
    table = Table.grid(padding=(0, 2, 0, 0))
    tones = {"warning": "yellow", "note": "cyan", "ok": "green"}
    for level, topic, text in rows:
        table.add_row(Text(level, style=tones.get(level, "")), Text(topic), Text(text, overflow="fold"))
    console.print(table)
    if last:
        console.print(Text(last))


def _watched(doing: str, work: Callable[[Callable[[int, int], None]], Any]) -> Any:
    """Do `work`, with a status line on a terminal."""
    errors = make_console(stderr=True)
    with errors.status(doing) as status:
        return work(lambda tried, total: status.update(f"{doing}: {tried} of {total} tried"))


def _change(settings: Settings, advice: Advice, checked: Check | None) -> Change | None:
    """Return the most helpful change; for many people far apart that takes a while."""

    def look(progress: Callable[[int, int], None]) -> Change | None:
        if checked is None:
            return next(ranked_changes(settings, advice, progress), None)
        return checked_change(settings, advice, checked, progress)

    found: Change | None = _watched("looking for what would help", look)
    return found


_USER = {  # keys of the answer, and the attributes of `UserAdvice` that they have
    "name": "name", "asked_stiffness_npm": "asked_npm", "felt_stiffness_npm": "felt_npm", "free_mass_kg": "free_mass_kg",
    "compensated_stiffness_npm": "compensated_npm", "enough_impedance_nspm": "enough_impedance_nspm",
    "b_tc_over_m": "b_tc_over_m", "advised_damping_nspm": "advised_damping_nspm",
    "largest_impedance_nspm": "largest_impedance_nspm", "impedance_bound": "impedance_bound",
}  # fmt: skip


def _users(advice: Advice, checked: Check | None, keys: Iterable[str]) -> list[dict[str, Any]]:
    return [
        {key: getattr(user, _USER[key]) for key in keys} | {"laboratory_felt_npm": _felt_in(checked, user.name)}
        for user in advice.users
    ]


def _record(advice: Advice, session: LinearSession, change: Change | None, checked: Check | None) -> dict[str, Any]:
    findings = [*advice.findings, *_seen(checked)]
    users = _users(advice, checked, _USER)
    for number, user in enumerate(users):
        user["delay_ms"] = {f"{each.direction} {each.name}": 1e3 * each.delay_s for each in budget(session, number)}
    return {
        "scheme": advice.verdict.form, "stable": advice.verdict.stable,
        "spectral_radius": advice.verdict.spectral_radius, "radius_without_structural": advice.verdict.decaying,
        "largest_stable_stiffness_npm": advice.limit.stiffness_npm, "stiffness_npm": advice.stiffness_npm,
        "conditions": AS_IT_STANDS.conditions, "users": users,
        "findings": _told(findings),
        "warnings": [finding.text for finding in findings if finding.warns], "laboratory": _judged(checked),
        "change": {"set": change.setting, "effect": change.effect} if change else None,
    }  # fmt: skip


def _told(findings: Iterable[Finding]) -> list[dict[str, str]]:
    return [{"topic": each.topic, "level": each.level, "text": each.text} for each in findings]


def _stiffest_record(found: Stiffest, checked: Check | None) -> dict[str, Any]:
    return {
        "set": [Change.written(key, value) for key, value in found.overrides.items()],
        "damper_nspm": found.damper_nspm, "stiffness_npm": found.stiffness_npm, "felt_stiffness_npm": found.felt_npm,
        "largest_stable_stiffness_npm": found.limit.stiffness_npm, "bounded_by": found.bounded,
        "laboratory": _judged(checked),
        "users": _users(found.advice, checked, ("name", "felt_stiffness_npm", "free_mass_kg")),
    }  # fmt: skip


def _in_sessions(checked: Check | None) -> str:
    """Return the range of what was felt in sessions, "" where it is none: jitter and loss soften contact."""
    found = [value for values in checked.felt_npm.values() for value in values if value is not None] if checked else []
    if not found or max(found) < 1.01 * min(found):
        return ""
    return f"{plain(min(found), 3)} to {plain(max(found), 3)} N/m felt at rest in sessions over this link; "


def _judged(checked: Check | None) -> dict[str, Any] | None:
    """Return the verdict on the session in virtual time; None where none was run."""
    if checked is None:
        return None
    finding = checked.session
    return {
        "seconds": checked.seconds, "passive": checked.passive == "good", "stable": checked.stable == "good",
        "level": finding.level, "text": finding.text,
    }  # fmt: skip


def _felt_in(checked: Check | None, name: str) -> list[float | None] | None:
    """Return the felt stiffness [N/m], a value a seed; None where none was measured."""
    return list(checked.felt_npm[name]) if checked and name in checked.felt_npm else None
