"""Networks by name: what [link] makes of them, and that the page shows the numbers of the code."""

import re
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.network_profiles import PROFILES, ProfileName
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.table import SettingsError

from tests.protocol.spec_page import rows

PAGE = Path(__file__).resolve().parents[2] / "docs" / "networks.md"


def both(**link: object) -> tuple[LinkProfile, LinkProfile]:
    settings = resolve({"link": link})
    return settings.link.direction("up"), settings.link.direction("down")


@pytest.mark.parametrize("name", PROFILES)
def test_a_profile_is_a_link_and_reaches_the_seat(name: str) -> None:
    up, down = both(profile=name)
    assert up == LinkProfile(**PROFILES[name].direction("up"))
    assert down == LinkProfile(**PROFILES[name].direction("down"))
    seat = seat_settings(resolve({"link": {"profile": name}}), 0)
    assert (seat.up, seat.down) == (up, down)


def test_every_name_has_its_profile() -> None:
    assert list(PROFILES) == list(get_args(ProfileName))


def test_keys_beside_a_profile_override_it_the_narrower_the_stronger_and_take_it_back() -> None:
    up, down = both(profile="lte", loss=0.2, jitter_ms=9.0, up={"jitter_ms": 0.0})
    assert (up.delay_ms, up.loss, up.jitter_ms) == (25.0, 0.2, 0.0)
    assert (down.delay_ms, down.loss, down.jitter_ms) == (15.0, 0.2, 9.0)
    up, _ = both(profile="wifi", outage_s=0.0, outage_every_s=0.0)
    assert (up.outage_s, up.outage_every_s, up.jitter_ms) == (0.0, 0.0, 8.0)


@pytest.mark.parametrize(
    ("link", "words"),
    [
        ({"profile": "wlan"}, 'link.profile: expects "lan", "wifi", "wan", "lte" or "satellite"; got \'wlan\''),
        ({"outage_s": 3.0}, "link.up.outage_s = 3: link.up.outage_every_s, from one outage's begin to the next, is 0"),
        ({"outage_s": 3.0, "outage_every_s": 3.0}, "link.up.outage_s = 3: .* is 3; give more than 3"),
        ({"outage_s": 0.5, "outage_every_s": 1.0, "down": {"outage_s": 2.0}}, "link.down.outage_s = 2: .* is 1"),
        ({"outage_every_s": 3.0}, "link.up.outage_every_s = 3: link.up.outage_s, how long each lasts, is 0"),
        ({"profile": "wifi", "outage_s": 0.0}, "link.up.outage_every_s = 120"),
        ({"profile": "wifi", "loss": 0.9}, "link.burst_frames = 5 is too short for link.loss = 0.9"),
        ({"outages": [[1.0, 0.0]]}, r"link.outages.0.1: expects a number above 0; got 0.0"),
        ({"outages": [[-1.0, 1.0]]}, r"link.outages.0.0: expects a number of at least 0; got -1.0"),
        ({"outages": [[1.0]]}, r"link.outages.0: expects a list of length 2; got \[1.0\]"),
        ({"outages": [[1.0, 1.0]] * 65}, r"link.outages: expects a list of length at most 64; got .*"),
        ({"trace": ""}, "link.trace: expects a text of length at least 1; got ''"),
    ],
)
def test_what_is_said_of_an_impossible_network(link: dict, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        resolve({"link": link})


def test_scripts_and_traces_stay_at_home() -> None:
    link = resolve({"link": {"outages": [[1, 2]], "up": {"trace": "t.csv", "outages": []}}}).link
    assert (link.script("up"), link.script("down")) == ((), ((1.0, 2.0),))
    assert (link.trace_of("up"), link.trace_of("down")) == ("t.csv", "")
    assert link.kept_back == ("link.outages", "link.trace")
    assert link.direction("up") == LinkProfile()
    assert resolve({"link": {"profile": "wifi"}}).link.kept_back == ()


@pytest.mark.parametrize(
    ("link", "allowed"),
    [
        ({"outage_s": 0.0, "outage_every_s": 0.0}, True),
        ({"outage_s": 0.5, "outage_every_s": 0.6}, True),
        ({"outage_s": 0.5, "outage_every_s": 0.5}, False),
        ({"outage_s": 0.0, "outage_every_s": 1.0}, False),
        ({"outage_s": 1.0, "outage_every_s": 0.0}, False),
        ({"rate_kbps": 1.0}, True),
        ({"rate_kbps": 0.999}, False),
        ({"rate_kbps": 5e-324}, False),
    ],
)
def test_a_welcome_with_an_endless_outage_or_a_cap_that_lets_nothing_through_is_malformed(
    link: dict[str, float], allowed: bool
) -> None:
    seat = list(msgspec.to_builtins(seat_settings(resolve({}), 0)))
    names = LinkProfile.__struct_fields__
    seat[11] = [link.get(name, value) for name, value in zip(names, seat[11], strict=True)]
    text = msgspec.msgpack.encode(seat)
    if allowed:
        msgspec.msgpack.decode(text, type=SeatSettings)
    else:
        with pytest.raises(msgspec.ValidationError, match=r"outage|[Ee]xpect"):
            msgspec.msgpack.decode(text, type=SeatSettings)


def test_the_page_shows_the_numbers_of_the_code() -> None:
    """docs/networks.md, the table of profiles: name, direction, then a column for each key; empty is the default."""
    text = PAGE.read_text(encoding="utf-8").replace("`", "")
    (head,) = re.findall(r"^\| profile \| direction \|(.*)\|$", text, re.MULTILINE)
    keys = [key.strip() for key in head.split("|")]
    assert {
        (name, direction): {key: float(cell) for key, cell in zip(keys, cells, strict=True) if cell}
        for name, direction, *cells in rows(text, "profile | direction")
    } == {
        (name, direction): dict(each.direction(direction))
        for name, each in PROFILES.items()
        for direction in ("up", "down")
    }
