"""`rates.network_hz = "auto"`: the shortest loop that device loops, link and server bear, both sides of each bound."""

import pytest

from cogrip.protocol.settings.delays import line_delay
from cogrip.protocol.settings.network_rate import (
    HEAD_BYTES,
    LINK_SHARE,
    PERSON_S,
    RATES_HZ,
    REAL_BYTES,
    SERVER_SHARE,
    WORLD_S,
)
from cogrip.protocol.settings.network_rate import best_rate as best
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Playout, Settings
from cogrip.protocol.settings.table import SettingsError


def chosen(people: int = 1, **tables: object) -> Settings:
    return resolve({"users": [{}] * people, **tables, "rates": {"network_hz": "auto", **tables.get("rates", {})}})  # type: ignore[dict-item]


def loop_s(settings: Settings, hz: int) -> float:
    rates = Rates(settings.rates.device_hz, hz)
    ways = (settings.link.direction("up"), settings.link.direction("down"))
    return sum(line_delay(settings.playout, way, rates).ticks for way in ways) * rates.tick_s + rates.frame_s


@pytest.mark.parametrize("profile", ["lan", "wifi", "wan", "lte"])
def test_no_rate_that_is_borne_has_a_shorter_loop(profile: str) -> None:
    settings = chosen(link={"profile": profile})
    best_s = loop_s(settings, settings.rates.network_hz)
    assert best_s == min(loop_s(settings, hz) for hz in RATES_HZ)
    assert best_s < loop_s(settings, 128)


def test_the_server_bears_so_many_people() -> None:
    for hz in RATES_HZ[1:]:
        most = int(SERVER_SHARE / (PERSON_S * hz))
        assert chosen(most).rates.network_hz >= hz
        assert chosen(most + 1).rates.network_hz < hz


def test_a_scene_costs_as_much_as_its_world() -> None:
    def rate(scene: bool, people: int) -> int:
        way = resolve({"users": [{}]}).link.direction("up")
        return best([1024] * people, 3, PERSON_S * people + WORLD_S * scene, Playout(), (way, way))

    assert rate(False, 3) == 1024
    assert rate(True, 3) == max(hz for hz in RATES_HZ if (3 * PERSON_S + WORLD_S) * hz <= SERVER_SHARE)


@pytest.mark.parametrize("hz", RATES_HZ[1:])
def test_a_line_takes_a_part_of_the_links_capacity(hz: int) -> None:
    datagram_bytes = HEAD_BYTES + REAL_BYTES * 1 * (8 + 4)
    kbps = 8e-3 * datagram_bytes * hz / LINK_SHARE
    assert chosen(link={"rate_kbps": kbps * 1.001}).rates.network_hz >= hz
    assert chosen(link={"up": {"rate_kbps": kbps * 0.999}}).rates.network_hz < hz


def test_everybodys_device_loop_has_whole_frames() -> None:
    assert chosen(rates={"device_hz": 512}).rates.network_hz == 512
    slow = resolve({"rates": {"network_hz": "auto"}, "users": [{"device_hz": 1024}, {"device_hz": 1280}]})
    assert slow.rates.network_hz == 256
    with pytest.raises(SettingsError, match="whole multiple"):
        chosen(rates={"device_hz": 1000})


def test_a_number_is_left_alone_and_auto_is_said_by_nothing_else() -> None:
    assert resolve({"users": [{}]}).rates.network_hz == 128
    assert resolve({"users": [{}]}, {"rates.network_hz": "auto"}) == resolve(
        {"users": [{}]}, {"rates.network_hz": 1024}
    )
    with pytest.raises(SettingsError, match=r"rates\.network_hz"):
        resolve({"rates": {"network_hz": "fast"}, "users": [{}]})
