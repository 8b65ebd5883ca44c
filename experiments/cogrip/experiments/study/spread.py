"""Differences between simulated participants: numbers of their hands, drawn by the study's seed.

k' = k exp(s (g_person + g_session / 2)),   g_person, g_session ~ N(0, 1), s = simulated.spread.KEY
"""

from collections.abc import Iterable, Mapping
from math import exp
from random import Random

from msgspec.structs import replace

from cogrip.protocol.settings.sections import Settings

Spread = Mapping[str, float]


def unfit_spread(spread: Spread, hands: Iterable[str]) -> str:
    """Return why a study with these hands cannot have the spread, "" if it can."""
    known = {key for hand in hands for key, value in _items(hand) if _number(value) is not None}
    lacking = next((key for key in spread if key not in known), None)
    if lacking is None:
        return ""
    there = f"there is: {', '.join(sorted(known))}" if known else "there is none"
    return f"simulated.spread.{lacking}: no hand gives that key a number; {there}; add it to a hand, or leave it out"


def varied(settings: Settings, spread: Spread, seed: int) -> Settings:
    """Return the settings of a session with hands of their own for its people. seed: of the study."""
    return replace(
        settings,
        users=tuple(replace(each, hand=_hand(each.hand, each.name, settings, spread, seed)) for each in settings.users),
    )


def _hand(hand: str, person: str, settings: Settings, spread: Spread, seed: int) -> str:
    words = [hand.partition("&")[0]]
    for key, value in _items(hand):
        number = _number(value)
        if key in spread and number is not None:
            own = Random(f"{seed}/{person}/{key}/hand").gauss()
            now = Random(f"{seed}/{person}/{key}/{settings.seed}/hand").gauss()
            value = f"{number * exp(spread[key] * (own + 0.5 * now)):.4g}"
        words.append(f"{key}={value}")
    return "&".join(words)


def _items(hand: str) -> list[tuple[str, str]]:
    return [(key, value) for key, _, value in (item.partition("=") for item in hand.split("&")[1:])]


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
