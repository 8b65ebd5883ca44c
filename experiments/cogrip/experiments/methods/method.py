"""The methods and networks of a comparison by name, and the settings of one session.

A method is a table of overrides of the given settings; everything else (hands, object, K, B, b, rates) stays.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import gcd
from typing import Any

import msgspec

from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS
from cogrip.protocol.settings.network_profiles import PROFILES
from cogrip.protocol.settings.room import rates_of, resolve
from cogrip.protocol.settings.sections import OWN_COUPLING, Settings
from cogrip.protocol.settings.table import copied

CLEAN, OWN = "clean", "own"


class ChoiceError(ValueError):
    """An unknown method or network; the text names near ones."""


@dataclass(frozen=True, slots=True)
class Method:
    """A coupling scheme that is compared.

    title      in words
    ours       cogrip's own, which is to stay stable and passive: a comparison in which it does not has failed. Else a baseline,
               whose failure is a result
    overrides  settings by their path
    """

    title: str
    ours: bool
    overrides: Mapping[str, Any]


def named(method: str) -> str:
    """Return a method's name, as it is typed and stands in tables, and its title: `tdpa: time-domain passivity`."""
    return f"{method}: {METHODS[method].title}"


_WAVE: Mapping[str, Any] = {
    "coupling.kind": "wave",
    "coupling.server_step": "passive",
    "coupling.decimator": "boxcar",
    "coupling.encoder": "displacement",
    "playout.frames": "auto",
}
METHODS: Mapping[str, Method] = {
    "wave": Method("cogrip's waves", True, _WAVE),
    "tuned": Method(
        "cogrip's waves, tuned",
        True,
        {
            **_WAVE,
            "coupling.impedance_nspm": "auto",
            "coupling.wave_filter_hz": "auto",
            "coupling.prefer": "balanced",
            "coupling.compensate": False,
        },
    ),
    "local": Method(
        "cogrip's local contact",
        True,
        {"coupling.kind": "local", "coupling.server_step": "passive", "playout.frames": "auto"},
    ),
    "paper": Method(
        "the paper's waves",  # over the same line: what differs is P's own filter, encoder and server step
        False,
        {
            "coupling.kind": "wave",
            "coupling.server_step": "paper",
            "coupling.decimator": "lowpass",
            "coupling.lowpass_rad_s": 50.0,
            "coupling.encoder": "velocity",
            "playout.frames": "auto",
        },
    ),
    "coupling": Method("virtual coupling", False, {"coupling.kind": "coupling", "coupling.server_step": "passive"}),
    "tdpa": Method("time-domain passivity", False, {"coupling.kind": "tdpa", "coupling.server_step": "passive"}),
    "partner": Method(
        "cogrip's models of partners", True, {"coupling.kind": "partner", "coupling.server_step": "passive"}
    ),
}
NETWORKS: tuple[str, ...] = tuple(PROFILES)


def methods_of(settings: Settings) -> tuple[str, ...]:
    """Return the methods that the object of these settings has, by the traits of object and scheme; the paper has no scenes.

    Raises SceneError for a scene that cannot be used.
    """
    thing = settings.object.traits

    def fits(overrides: Mapping[str, Any]) -> bool:
        scheme = COUPLING_KINDS[overrides["coupling.kind"]]
        local = thing.local or not scheme.local
        held = thing.held or not scheme.one_object or (thing.scene and _is_copied(settings))
        return local and held and not (thing.scene and overrides["coupling.server_step"] == "paper")

    return tuple(name for name, method in METHODS.items() if fits(method.overrides))


def _is_copied(settings: Settings) -> bool:
    """Return whether clients can make copies of a scene."""
    from cogrip.server.worlds.scenes.copied_geometry import unfit_copy  # with MuJoCo
    from cogrip.server.worlds.scenes.scene_file import scene_of_settings

    given = settings.object
    if given.axes != PLACES or given.script or any(user.grips for user in settings.users):
        return False
    return not unfit_copy(scene_of_settings(settings, 1.0 / settings.rates.network_hz))


def choose(what: str, asked: Iterable[str], known: Sequence[str]) -> tuple[str, ...]:
    """Return the names asked for, without repeats, in their order. Raises ChoiceError."""
    found: dict[str, None] = {}
    for name in asked:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
            cure = f"did you mean {near[0]}? " if near else ""
            raise ChoiceError(f"there is no {what} {name!r}; {cure}there are: {', '.join(known)}")
        found[name] = None
    if not found:
        raise ChoiceError(f"no {what} is named; there are: {', '.join(known)}")
    return tuple(found)


def session_settings(base: Mapping[str, Any], method: str, network: str, seed: int) -> Settings:
    """Return the settings of one session. network: a profile's name, CLEAN, or OWN for [link] itself. Raises SettingsError."""
    table = copied(base)
    if network != OWN:
        table["link"] = {} if network == CLEAN else {"profile": network}
    overrides = METHODS[method].overrides
    _seed(table, seed)
    _drop_own(table, overrides)
    return resolve(table, overrides)


def ideal_settings(base: Mapping[str, Any], seed: int) -> Settings:
    """Return the object directly in the hands: springs K, B at the device rate, without a network. Raises SettingsError."""
    table = copied(base)
    table["link"] = {}
    settings = resolve(table)
    rates = [rates_of(settings, user).device_hz for user in settings.users]
    common_hz = gcd(*rates)
    if common_hz != settings.rates.device_hz:
        for user, rate_hz in zip(table["users"], rates, strict=True):
            user["device_hz"] = rate_hz
    overrides = {
        "coupling.kind": "coupling",
        "coupling.server_step": "passive",
        "coupling.compensate": False,
        "rates.device_hz": common_hz,
        "rates.network_hz": common_hz,
    }
    _seed(table, seed)
    _drop_own(table, overrides)
    return resolve(table, overrides)


def _drop_own(table: dict[str, Any], overrides: Mapping[str, Any]) -> None:
    """Remove each user's own value, which would stand above the method's."""
    for key in overrides:
        section, _, name = key.partition(".")
        if section == "coupling" and name in OWN_COUPLING:
            for user in table["users"]:
                user[name] = None


def _seed(table: dict[str, Any], seed: int) -> None:
    """Set the seed of the network and, one derived from it each, of hands that tremble."""
    table["seed"] = seed
    for number, user in enumerate(table["users"]):
        for key in ("hand", "device"):
            user[key] = _trembling(user[key], seed, number)


def _trembling(address: str, seed: int, number: int) -> str:
    """Return the address with a tremor's seed, derived from its own one, the session's and the person's number."""
    name, mark, query = address.partition("?") if address.startswith("sim:") else ("", "", address)
    items = query.split("&")
    if not any(item in ("tremor", "hand=tremor") for item in items):
        return address
    own = next((int(float(item.removeprefix("seed="))) for item in items if item.startswith("seed=")), 0)
    kept = [item for item in items if not item.startswith("seed=")]
    return f"{name}{mark}{'&'.join([*kept, f'seed={(own * 65_536 + seed) * 256 + number}'])}"


def described(settings: Settings) -> dict[str, Any]:
    """Return both directions of a session's link, in the words of [link]."""
    return {direction: msgspec.to_builtins(_as_table(settings, direction)) for direction in ("up", "down")}


def _as_table(settings: Settings, direction: Any) -> dict[str, Any]:
    return msgspec.structs.asdict(settings.link.direction(direction))
