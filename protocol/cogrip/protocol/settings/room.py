"""Settings of a room, from a TOML table with overrides, and of each of its seats.

`resolve` turns the raw table into `Settings` or raises SettingsError, which names the setting, its value, the bound and the
cure. `seat_settings` returns what one user's client and seat must agree on.
"""

from collections import Counter
from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from cogrip.protocol.axes import GRIP_AXES, PLACES, POSE_AXES
from cogrip.protocol.laws import felt_stiffness as felt
from cogrip.protocol.settings.coupling import (
    Coupling,
    CouplingSection,
    LineTuning,
    line_compliance,
    of_seat,
    round_trip_s,
    unfit_line,
)
from cogrip.protocol.settings.effects import unfit_section
from cogrip.protocol.settings.hand import WorkspaceLimit
from cogrip.protocol.settings.link_profile import LinkProfile, check_link
from cogrip.protocol.settings.network_rate import best_rate, stated_frame_s, take_auto
from cogrip.protocol.settings.object_fit import unfit_object
from cogrip.protocol.settings.rates import Rates, misfit
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import (
    ONLY_USER,
    OWN_COUPLING,
    REMOTE,
    Settings,
    User,
)
from cogrip.protocol.settings.table import SettingsError, copied, override, readable, refuse_unknown
from cogrip.protocol.settings.tool_frame import ToolFrame
from cogrip.protocol.settings.types import MOST_RENDERED_NPM


def resolve(table: Mapping[str, Any], overrides: Mapping[str, Any] | None = None) -> Settings:
    """Return settings from a TOML table and `--set` overrides ({"coupling.stiffness_npm": 500.0}). Raises SettingsError."""
    merged = copied(table)
    if "link.profile" in (overrides or {}):  # another network: it replaces the whole one of the file
        merged.pop("link", None)
    for key, value in (overrides or {}).items():
        override(merged, key, value, ONLY_USER)
    automatic = take_auto(merged)
    refuse_unknown(merged, Settings)
    users = merged.get("users")
    for index, user in enumerate(users if isinstance(users, list) else ()):
        if isinstance(user, dict):
            user.setdefault("name", f"user{index + 1}")
    try:
        settings = msgspec.convert(merged, Settings)
    except msgspec.ValidationError as error:
        raise SettingsError(readable(str(error), merged, Settings)) from None
    if automatic:
        settings = replace(settings, rates=replace(settings.rates, network_hz=best_network_hz(settings)))
    _check_fit(settings)
    return settings


def best_network_hz(settings: Settings, frame_s: float | None = None) -> int:
    """Return what "auto" is where a frame takes the server this time [s]; None: what is stated."""
    device_hz = [user.device_hz or settings.rates.device_hz for user in settings.users]
    took_s = stated_frame_s(settings) if frame_s is None else frame_s
    return best_rate(device_hz, settings.object.axes, took_s, settings.playout, link_directions(settings))


def link_directions(settings: Settings) -> tuple[LinkProfile, LinkProfile]:
    """Return both directions of the link, up and down."""
    return settings.link.direction("up"), settings.link.direction("down")


def for_remote_clients(settings: Settings) -> Settings:
    """Return the settings of a room that other machines may join: device records have bounds in any case."""
    admission = settings.admission
    bounds = {name: bound for name, bound in REMOTE.items() if getattr(admission, name) is None}
    return replace(settings, admission=replace(admission, **bounds))


def coupling_asked(settings: Settings, user: User) -> CouplingSection:
    """Return [coupling] with this user's own values."""
    own = {name: getattr(user, name) for name in OWN_COUPLING}
    return replace(settings.coupling, **{name: value for name, value in own.items() if value is not None})


def coupling_of(settings: Settings, user: User) -> Coupling:
    """Return the coupling of this user's seat."""
    return tuned_coupling(settings, user)[0]


def tuned_coupling(settings: Settings, user: User) -> tuple[Coupling, LineTuning]:
    """Return the coupling of this user's seat, and the tuning of its line."""
    asked, rates = coupling_asked(settings, user), rates_of(settings, user)
    return of_seat(asked, settings.playout, link_directions(settings), rates, user.grips)


def not_passive(settings: Settings) -> str:
    """Return the settings by which a room is not passive, "" if none does that."""
    coupling = settings.coupling
    if not coupling.traits.passive:
        return f'coupling.kind = "{coupling.kind}"'
    if not coupling.traits.waves:
        return ""
    active = ['coupling.server_step = "paper"'] if coupling.server_step == "paper" else []
    decimators = {coupling_of(settings, user).decimator for user in settings.users}
    return ", ".join(active + [f'decimator = "{each}"' for each in ("lowpass", "none") if each in decimators])


def seat_axes(settings: Settings, user: User) -> int:
    """Return the number of axes of a user's seat: in a room of poses only the places, where the hand does not turn its tool.

    One more where it drives a gripper.
    """
    axes = GRIP_AXES if user.grips else settings.object.axes
    return axes if axes < POSE_AXES or user.orientation in ("", "driven") else PLACES


def rates_of(settings: Settings, user: User) -> Rates:
    """Return [rates] with this user's own device rate."""
    device_hz = settings.rates.device_hz if user.device_hz is None else user.device_hz
    return Rates(device_hz, settings.rates.network_hz)


def seat_settings(settings: Settings, seat: int) -> SeatSettings:
    """Return what user number `seat` and the server share. Raises SettingsError where compensation is out of reach."""
    user = settings.users[seat]
    coupling, line = tuned_coupling(settings, user)
    rates, (up, down) = rates_of(settings, user), link_directions(settings)
    if why := unfit_line(coupling, line):
        raise SettingsError(f"users.{seat} ({user.name}): {why}")
    rendered = coupling.stiffness_npm
    if coupling.compensate and coupling.traits.felt_through_waves:
        compliance = line_compliance(coupling, line, rates, round_trip_s(settings.playout, (up, down), rates))
        try:
            rendered = felt.compensated_stiffness(coupling.stiffness_npm, coupling.impedance_nspm, compliance)
        except felt.OutOfReachError as error:
            raise SettingsError(f"users.{seat} ({user.name}): {error}") from None
        if rendered > MOST_RENDERED_NPM:
            raise SettingsError(
                f"users.{seat} ({user.name}): coupling.compensate would render {rendered:.4g} N/m, more than "
                f"{MOST_RENDERED_NPM:g}: raise coupling.impedance_nspm, or ask for less stiffness"
            )
    return SeatSettings(
        settings.name, user.name, seat, settings.seed, settings.seconds, rates, coupling, rendered,
        settings.object.shared(seat_axes(settings, user)), user.side, settings.playout, up, down, line, len(settings.users),
        *hand_of(settings, seat), user.gravity_compensation,
    )  # fmt: skip


def hand_of(settings: Settings, seat: int) -> tuple[ToolFrame | None, WorkspaceLimit]:
    """Return the frame of this seat's tool, None where it moves as the hand does, and its limit. Raises SettingsError."""
    user = settings.users[seat]
    try:
        return user.tool_and_limit(seat_axes(settings, user))
    except ValueError as error:
        raise SettingsError(f"users.{seat} ({user.name}): {error}") from None


def _check_fit(settings: Settings) -> None:
    users = [(f"users.{place}", user.device_hz) for place, user in enumerate(settings.users)]
    for key, device_hz in (("rates", settings.rates.device_hz), *users):
        if device_hz and (why := misfit(device_hz, settings.rates.network_hz, f"{key}.device_hz")):
            raise SettingsError(why)
    ((name, times),) = Counter(user.name for user in settings.users).most_common(1)
    if times > 1:
        raise SettingsError(f"users: the name {name!r} stands twice; give every user a name of their own")
    kind = settings.coupling.kind
    if settings.coupling.server_step == "paper" and not settings.coupling.traits.paper_step:
        raise SettingsError(
            f'coupling.server_step = "paper" is a step of the wave scheme; with coupling.kind = "{kind}" leave it "passive"'
        )
    check_link(settings.link)
    compensated = [user.name for user in settings.users if coupling_of(settings, user).compensate]
    if why := unfit_object(settings, compensated):
        raise SettingsError(why)
    for place, effect in enumerate(settings.effects):
        if why := unfit_section(effect, settings.object.axes):
            raise SettingsError(f"effects.{place}: {why}")
        if unknown := set(effect.users) - {user.name for user in settings.users}:
            raise SettingsError(f"effects.{place}.users: there is no user {min(unknown)!r}; name one of [[users]]")
        if effect.name and effect.name in [before.name for before in settings.effects[:place]]:
            raise SettingsError(
                f"effects.{place}.name = {effect.name!r} stands twice; give each effect a name of its own"
            )
    for seat in range(len(settings.users)):
        seat_settings(settings, seat)
