"""Advice before anyone holds a device: does a session lie inside what is stable, passive, and felt as asked?

`advise` needs the settings of everybody, `advise_seat` those of one seat and its device: a server and a client say the same
words about what each of them knows. A finding that warns says why and what to do; `advice_change` finds what would help most.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import sqrt

from cogrip.analysis.advice.effect_advice import effect_advice
from cogrip.analysis.advice.finding import Finding, Level, growth, plain
from cogrip.analysis.advice.free_end import GRIPS, free_end, free_end_text
from cogrip.analysis.feel.feel import no_contact, on_wall, slow_feel
from cogrip.analysis.linear.decimation_passivity import filter_of, largest_gain
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import (
    Form,
    LinearSession,
    linear_session,
    seat_session,
    seats_on_devices,
)
from cogrip.analysis.linear.stability import (
    SEARCHED_FROM_NPM,
    Limit,
    StabilityVerdict,
    largest_stable,
    optimistic_limit,
    verdict,
)
from cogrip.client.hand.velocity import Bound, largest_impedance
from cogrip.client.safety.rendered_damper import ROUNDING, bound_words, damper_on, refusal, rounded_down
from cogrip.devices.device import MOST_SLOPE_NPS, Capability
from cogrip.devices.for_user import make_for
from cogrip.devices.registry import is_input_only
from cogrip.protocol.laws.felt_stiffness import OutOfReachError, compensated_stiffness
from cogrip.protocol.line.concealment import held_force
from cogrip.protocol.settings.room import seat_axes, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings
from cogrip.results.verdict.felt_as_intended import STIFFNESS_JND

AMPLE = 1.5  # factor on a session's stiffness up to which it should stay stable
MUCH_GAIN = 1.1  # largest gain of a decimator without a warning
LITTLE_FELT = 0.25  # least share of the stiffness asked for that is felt without a warning
HEAVY_KG = 0.25  # mass that a line adds to free motion above which it is noted: a mug of coffee
BRISK_MPS, SLOW_TOUCH_MPS = 0.3, 0.1  # speeds with which hands touch things: briskly, and with care
_TINY = 1e-9
_NEAR = 1e-4  # relative accuracy of a stiffness
TOO_MUCH: dict[Form, str] = {
    "passive": "the damper that a device renders is too much for it",
    "paper": "the paper's server step uses a force one frame old",
    "coupling": "the damper that a device renders is too much for it, or acts too late over this delay",
}
INSTEAD: dict[Form, str] = {
    "passive": "",
    "paper": '; set coupling.server_step to "passive"',
    "coupling": '; set coupling.kind to "wave"',
}
_HALVINGS = 12  # number of halvings of a damper, to find one with which a session is stable


@dataclass(frozen=True, slots=True)
class UserAdvice:
    """One person's numbers.

    felt: on a wall, at rest; compensated: the K to render for the hand to feel what was asked, if any does; free_mass,
    device_mass: what free motion without contact feels like, device included, and the device alone; largest_impedance: the b,
    or B of virtual coupling, that the device carries, impedance_bound which bound that is (`largest_impedance`).
    """

    name: str
    asked_npm: float
    felt_npm: float
    compensated_npm: float | None
    enough_impedance_nspm: float | None
    free_mass_kg: float
    device_mass_kg: float
    b_tc_over_m: float
    advised_damping_nspm: float
    advised_stiffness_npm: float
    largest_impedance_nspm: float
    impedance_bound: Bound


@dataclass(frozen=True, slots=True)
class Advice:
    verdict: StabilityVerdict
    limit: Limit
    stiffness_npm: float  # largest stiffness that anybody's spring is rendered with
    users: tuple[UserAdvice, ...]
    findings: tuple[Finding, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        return tuple(finding.text for finding in self.findings if finding.warns)

    @property
    def refusals(self) -> tuple[str, ...]:
        """Warnings that refuse a session: what is known to be unstable, each with the value that would do."""
        return tuple(finding.text for finding in self.findings if finding.refused)


def largest(model: LiftedModel) -> Limit:
    """Return up to which stiffness a session is stable."""
    return largest_stable(model, relative=_NEAR, beyond=False)


def ample(model: LiftedModel) -> Limit:
    """Return the same, searched only as far as warnings need: to AMPLE."""
    to_npm = AMPLE * max(model.session.stiffness_npm) * (1.0 + _TINY)
    return largest_stable(model, relative=_NEAR, to_npm=to_npm, beyond=False)


def at_best(model: LiftedModel) -> Limit:
    """Return an upper bound of the same, from a few stiffnesses."""
    most = max(model.session.stiffness_npm)
    return optimistic_limit(model, [share * most for share in (0.1, 0.2, 0.4, 0.7, 1.0, AMPLE)])


def advise(settings: Settings, search: Callable[[LiftedModel], Limit] = largest) -> Advice:
    """Return advice on a room. Raises ModelError or DeviceError where there is no model, or no such device."""
    session = linear_session(settings)
    seats, records = zip(*seats_on_devices(settings), strict=True)
    sections = [_section(settings, number) for number in range(len(settings.users))]
    advice = _advise(session, seats, records, sections, search)
    effects = [effect_advice(settings, seat, record) for seat, record in zip(seats, records, strict=True)]
    findings = [Finding("effects", text, "ok" if whole else "note") for text, whole in effects if text]
    return replace(advice, findings=(*advice.findings, *findings))


def advise_seat(seat: SeatSettings, record: Capability) -> Advice:
    """Return the advice on one seat with its own device, alone with the object. Raises ModelError."""
    return _advise(seat_session(seat, record), [seat], [record], ["coupling"])


def overloads(settings: Settings) -> tuple[str, ...]:
    """People whose devices are asked for more than they carry, and the value that would do for each, the least first.

    No model is needed. Raises DeviceError.
    """
    found = []
    for number, user in enumerate(settings.users):
        seat, record = seat_settings(settings, number), make_for(user, seat_axes(settings, user)).capability
        if text := refusal(seat, record, _section(settings, number)):
            found.append((largest_impedance(record, seat.rates.tick_s).impedance_nspm, text))
    return tuple(text for _, text in sorted(found))


def unbounded(settings: Settings | SeatSettings) -> tuple[str, ...]:
    """Return why a scene may shake its hands, () where its limiter of waves, or a gate at each hand, bounds what comes out."""
    kind = settings.coupling.kind
    if not settings.object.traits.scene or settings.coupling.traits.waves or settings.coupling.traits.gated:
        return ()
    text = (
        f'coupling.kind = "{kind}": nothing bounds the energy that a scene makes under it, and no model tells whether it is '
        'stable: it is there to compare with; set coupling.kind = "wave"'
    )
    return (text,)


def _section(settings: Settings, number: int) -> str:
    """Return the section of settings with the damper of this person's device: a user's own value is above [coupling]'s."""
    own = getattr(settings.users[number], settings.coupling.traits.damper.key)
    return "coupling" if own is None else f"users.{number}"


def _advise(
    session: LinearSession,
    seats: Sequence[SeatSettings],
    records: Sequence[Capability],
    sections: Sequence[str],
    search: Callable[[LiftedModel], Limit] = largest,
) -> Advice:
    model = LiftedModel(session)
    found, most = verdict(model), max(session.stiffness_npm)
    limit = search(model) if most else Limit(None, 0.0)  # nobody holds the object by a spring
    users = tuple(_user(session, number, *one) for number, one in enumerate(zip(seats, records, strict=True)))
    findings = [_stability(session, found, limit, most), *_passivity(seats)]
    for number, (user, seat, record, section) in enumerate(zip(users, seats, records, sections, strict=True)):
        findings += _free_end(session, number, seat, section)
        findings += _seat(user, seat, record, section, limit)
    return Advice(found, limit, most, users, tuple(findings))


def _stability(session: LinearSession, found: StabilityVerdict, limit: Limit, stiffness_npm: float) -> Finding:
    if limit.stiffness_npm == 0.0:
        why = f"{TOO_MUCH[session.form]}; {_calmer(session)}"
        text = f"NOT stable at any stiffness, by the linear model with free hands: {why}"
        return Finding("stability", text, "warning", refused=True)
    if not found.stable:
        reach = "" if limit.stiffness_npm is None else f", and none up to {plain(limit.stiffness_npm)} N/m"
        text = (
            f"the linear model predicts {growth(found.decaying, session.frame_s)} with free hands at K = "
            f"{plain(stiffness_npm)} N/m (spectral radius {found.decaying:.6g} a frame){reach}; hands may damp it, and a short "
            "session need not show it"
        )
        return Finding("stability", text, "warning")
    if limit.stiffness_npm is None:
        return Finding("stability", "stable, and at any stiffness" if limit.searched_to_npm else "stable")
    share = limit.stiffness_npm / stiffness_npm
    text = f"stable up to {plain(limit.stiffness_npm)} N/m, {share:.2f} times the {plain(stiffness_npm)} N/m that is rendered"
    if session.traits.passive:
        text += "; beyond it, a device's own damper is unstable on its sampled or estimated velocity"
    return Finding("stability", text, "warning" if share < AMPLE else "ok")


def _free_end(session: LinearSession, number: int, seat: SeatSettings, section: str) -> Iterator[Finding]:
    """Say whether the force grows where this person touches nothing, whoever holds the device."""
    found = free_end(session, number)
    if found is None:
        return
    text = f"{seat.user}: {free_end_text(found, session.frame_s, f'set {section}.impedance_nspm to')}"
    yield Finding("free end", text, "warning" if found.growing else "ok", refused=len(found.growing) == len(GRIPS))


def _passivity(seats: Sequence[SeatSettings]) -> list[Finding]:
    coupling = seats[0].coupling
    if not coupling.traits.passive:
        text = "not passive: plain virtual coupling makes energy of delay, so its stability holds for these very numbers only"
        return [Finding("passivity", text, level="note")]
    found = []
    if coupling.traits.one_object:
        text = (
            "what each hand gets its own gate bounds: what it has put in, what partners gave, and the budget of its seat, "
            "whatever network and partners do"
        )
        return [Finding("passivity", text)]
    if coupling.traits.local:
        text = "contact is each client's own, bounded by the energy at its device; the line behind it is passive on any network"
        return [Finding("passivity", text)]
    if coupling.server_step == "paper":
        text = "not passive: the paper's server step uses a force one frame old, so stability holds for these very numbers only"
        found.append(Finding("passivity", text, level="note"))
    for seat in seats:
        kind, rates = seat.coupling.decimator, seat.rates
        gain, _ = largest_gain(filter_of(kind, rates, seat.coupling.lowpass_rad_s), rates.ticks_per_frame)
        if gain > 1.0 + _TINY:
            text = f'{seat.user}: decimator "{kind}" can make up to {100.0 * (gain - 1.0):.3g} % energy of what aliases'
            found.append(Finding("passivity", text, level="warning" if gain > MUCH_GAIN else "note"))
    return found or [Finding("passivity", "line and object are passive by construction, on any network")]


def _user(session: LinearSession, number: int, seat: SeatSettings, record: Capability) -> UserAdvice:
    person, coupling = session.people[number], seat.coupling
    felt = slow_feel(on_wall(session, number), 0).stiffness_npm
    free_kg = person.device_mass_kg + slow_feel(no_contact(session, number), 0).inertia_kg
    compensated = enough = None
    if session.traits.passive and coupling.stiffness_npm > 0.0:
        # C_line from the model itself: 1 / K_felt - 1 / K_rendered
        compliance = 1.0 / felt - 1.0 / seat.rendered_npm
        try:
            compensated = compensated_stiffness(coupling.stiffness_npm, person.impedance_nspm, compliance)
        except OutOfReachError:
            enough = coupling.stiffness_npm * compliance * person.impedance_nspm
    share = damper_on(seat, record).value_nspm * seat.rates.tick_s / person.device_mass_kg
    carried = largest_impedance(record, seat.rates.tick_s)
    return UserAdvice(
        person.name, coupling.stiffness_npm, felt, compensated, enough, free_kg, person.device_mass_kg, share,
        record.damping_nspm, record.stiffness_npm, carried.impedance_nspm, carried.bound,
    )  # fmt: skip


def _calmer(session: LinearSession) -> str:
    """The largest damper with which the session is stable at some stiffness, as the cure of one that is at none."""
    key = session.traits.damper_key
    values = [getattr(person, key) for person in session.people]

    def stable(share: float) -> bool:
        people = tuple(replace(person, **{key: share * getattr(person, key)}) for person in session.people)
        return optimistic_limit(LiftedModel(replace(session, people=people)), [SEARCHED_FROM_NPM]).stiffness_npm is None

    low = next((share for power in range(1, _HALVINGS) if stable(share := 0.5**power)), None)
    if low is None:
        return f"no {key} would do{INSTEAD[session.form]}"
    high = 2.0 * low
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    if min(values) < max(values):
        return f"multiply everybody's {key} by {rounded_down(low):g} or less"
    return f"set coupling.{key} to {rounded_down(low * values[0]):g} or less"


def _seat(user: UserAdvice, seat: SeatSettings, record: Capability, section: str, limit: Limit) -> Iterator[Finding]:
    damper = damper_on(seat, record)
    if is_input_only(f"{record.family}:"):
        text = "is input only: no force reaches the hand, and what is said of its feel is that of its simulated mass"
        yield Finding("device", f"{user.name}: {record.family}:{record.model} {text}", "note")
    yield _carried(user.name, seat, record, section)
    if not seat.coupling.traits.felt_through_waves:
        yield from _own_spring(user, seat, record)
    if user.felt_npm > record.stiffness_npm * (1.0 + 1e-9):
        yield Finding(
            "device",
            f"{user.name}: a felt {plain(user.felt_npm)} N/m is more than the {plain(record.stiffness_npm)} N/m that the "
            f"record of device {record.family}:{record.model} advises; set coupling.stiffness_npm lower",
            level="warning",
        )
    if user.asked_npm:
        yield Finding("feel", _felt_text(user, seat, limit), feel_level(user.felt_npm, user.asked_npm))
    if seat.line.live or seat.line.wave_filter_hz:
        yield Finding("line", _line_text(user.name, seat, damper.value_nspm))
    yield from gaps(f"{user.name}: ", seat, damper.value_nspm, record.continuous_force_n)
    yield _free(user)


def carried_finding(settings: Settings, number: int, record: Capability) -> Finding:
    """Return whether a person's device carries the damper that the settings ask of it."""
    return _carried(settings.users[number].name, seat_settings(settings, number), record, _section(settings, number))


def _carried(name: str, seat: SeatSettings, record: Capability, section: str) -> Finding:
    damper, carried = damper_on(seat, record), largest_impedance(record, seat.rates.tick_s)
    if text := refusal(seat, record, section):
        return Finding("device", text, "warning", refused=True)
    share = damper.value_nspm * seat.rates.tick_s / record.apparent_mass_kg
    return Finding(
        "device",
        f"{name}: {damper.symbol} T_c / m = {share:.2f}; {damper.symbol} = {damper.value_nspm:g} of at most "
        f"{carried.impedance_nspm:.3g} N s/m, its {carried.bound} bound, where {bound_words(carried, record)}",
    )


def _own_spring(user: UserAdvice, seat: SeatSettings, record: Capability) -> Iterator[Finding]:
    """Yield what bounds a spring that the client renders itself: the device port, and the slope of its force."""
    carried, K = largest_impedance(record, seat.rates.tick_s), seat.rendered_npm
    most_npm = carried.impedance_nspm / (carried.lag_ticks * seat.rates.tick_s)
    if most_npm * (1.0 + ROUNDING) < K:
        yield Finding(
            "device",
            f"{user.name}: of {plain(K)} N/m the device port renders {plain(most_npm)} N/m at most, as the damper of this "
            f"device is {carried.lag_ticks:.2g} ticks late; set coupling.stiffness_npm to {rounded_down(most_npm):g} or less",
            feel_level(most_npm, K) if feel_level(most_npm, K) != "ok" else "note",
        )
    slope_nps = min(record.slew_nps, MOST_SLOPE_NPS)
    if K and (fastest_mps := slope_nps / K) < BRISK_MPS:
        yield Finding(
            "device",
            f"{user.name}: {plain(K)} N/m met faster than {plain(fastest_mps, 2)} m/s would need a force that rises by more "
            f"than {plain(slope_nps)} N/s: it is softer then",
            "warning" if fastest_mps < SLOW_TOUCH_MPS else "note",
        )


def _line_text(name: str, seat: SeatSettings, impedance_nspm: float) -> str:
    corner = seat.line.wave_filter_hz
    filtered = f"a filter of {plain(corner, 3)} Hz" if corner else "no filter"
    chosen = f'; "auto" changes them with the delay as measured, {seat.line.prefer}' if seat.line.live else ""
    return (
        f"{name}: b = {plain(impedance_nspm, 3)} N s/m and {filtered} on a loop of {1e3 * seat.loop_s:.0f} ms{chosen}"
    )


def gaps(whom: str, seat: SeatSettings, impedance_nspm: float, wanted_n: float) -> Iterator[Finding]:
    """Say up to which force the credit holds a hand through missing frames (theory 3.5), and which holds all it can have."""
    coupling, lossy = seat.coupling.traits, max(seat.up.loss, seat.down.loss) > 0.0
    if not coupling.felt_through_waves or seat.playout.concealment != "elastic" or not lossy:
        return
    one_mj_n = held_force(impedance_nspm, 1e-3, seat.rates.frame_s, seat.object.axes)
    held_n, enough_mj = one_mj_n * sqrt(seat.playout.tank_mj), (wanted_n / one_mj_n) ** 2
    text = (
        f"{whom}{plain(held_n, 2)} N are held in full where frames are lost, by a credit of {seat.playout.tank_mj:g} mJ"
    )
    if held_n >= wanted_n:
        yield Finding("gaps", text)
        return
    yield Finding(
        "gaps",
        f"{text}; a larger force feels softer; the {plain(wanted_n, 3)} N that the device gives for ever would take "
        f"playout.tank_mj = {plain(enough_mj, 2)}",
        "note",
    )


def feel_level(felt_npm: float, asked_npm: float) -> Level:
    """Return how a felt stiffness stands to the one asked for: "ok" where a hand cannot tell them apart."""
    if abs(felt_npm / asked_npm - 1.0) <= STIFFNESS_JND:
        return "ok"
    return "note" if felt_npm >= LITTLE_FELT * asked_npm else "warning"


def _felt_text(user: UserAdvice, seat: SeatSettings, limit: Limit) -> str:
    link = (seat.up, seat.down) if not seat.coupling.traits.local else ()
    jitter = seat.playout.frames != "auto" and any(each.jitter_ms for each in link)  # "auto": in the playout delay
    left_out = [name for name, there in (("jitter", jitter), ("loss", any(each.loss for each in link))) if there]
    where = f" at rest, calculated without the link's {' and '.join(left_out)}" if left_out else " at rest"
    text = f"{user.name}: {plain(user.asked_npm)} N/m will feel like {plain(user.felt_npm)} N/m{where}"
    if seat.coupling.compensate or seat.line.auto_filter:
        return text
    if user.compensated_npm is not None:
        if limit.stiffness_npm is not None and user.compensated_npm > limit.stiffness_npm:
            return f"{text}; compensation would render {plain(user.compensated_npm)} N/m, which is not stable"
        return f"{text}; compensation is possible (it would render {plain(user.compensated_npm)} N/m)"
    if user.enough_impedance_nspm is not None:
        return (
            f"{text}; compensation is out of reach at b = {seat.coupling.impedance_nspm:g} N s/m, "
            f"b > {user.enough_impedance_nspm:.3g} would do"
        )
    return text


def _free(user: UserAdvice) -> Finding:
    added_kg = user.free_mass_kg - user.device_mass_kg
    text = f"{user.name}: will feel like {user.free_mass_kg:.2g} kg, {user.device_mass_kg:.2g} kg of it the device"
    return Finding("free motion", text, "note" if added_kg > HEAVY_KG else "ok")
