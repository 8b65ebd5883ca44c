"""Settings of impedance and filter, in numbers and "auto": what a seat begins with, what its client may change, bad input."""

from typing import Any, get_args, get_type_hints

import msgspec
import pytest

from cogrip.protocol.settings.coupling import LEAST_FILTER_HZ, CouplingSection, LineTuning
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.line_tuning import USUAL_NSPM, corner_hz, tuning
from cogrip.protocol.settings.room import coupling_of, resolve, seat_settings
from cogrip.protocol.settings.sections import OWN_COUPLING, Settings, User
from cogrip.protocol.settings.table import SettingsError

AUTO = {"impedance_nspm": "auto", "wave_filter_hz": "auto"}
TWO = [{"name": "anna"}, {"name": "ben"}]


def settings(link: dict[str, Any] | None = None, users: list[dict[str, Any]] = TWO, **coupling: Any) -> Settings:
    return resolve({"coupling": coupling, "link": link or {}, "users": users})


@pytest.mark.parametrize("delay_ms", [0.0, 60.0, 140.0, 300.0])
@pytest.mark.parametrize("prefer", ["light", "balanced", "stiff"])
def test_auto_begins_with_what_suits_the_delay_of_the_settings(delay_ms: float, prefer: Any) -> None:
    seat = seat_settings(settings({"delay_ms": delay_ms}, **AUTO, prefer=prefer), 0)
    suits = tuning(seat.loop_s, prefer)
    assert seat.loop_s == pytest.approx(2e-3 * delay_ms + 1 / 128, abs=2e-3)
    assert seat.coupling.impedance_nspm == suits.impedance_nspm
    assert seat.line == LineTuning(corner_hz(suits.filter_lag_s), True, True, prefer)


def test_each_of_the_two_may_be_a_number_and_each_user_has_their_own() -> None:
    own = [{"name": "anna", "impedance_nspm": 8.0}, {"name": "ben", "wave_filter_hz": 2.0, "prefer": "light"}]
    anna, ben = [seat_settings(settings({"delay_ms": 300.0}, own, **AUTO), number) for number in range(2)]
    assert (anna.coupling.impedance_nspm, anna.line.auto_impedance, anna.line.auto_filter) == (8.0, False, True)
    assert (ben.line.wave_filter_hz, ben.line.auto_impedance, ben.line.auto_filter) == (2.0, True, False)
    assert ben.coupling.impedance_nspm == pytest.approx(1.0 / ben.loop_s)


@pytest.mark.parametrize("scheme", [{"kind": "tdpa"}, {"kind": "coupling"}, {"server_step": "paper"}])
def test_other_schemes_keep_the_usual_impedance_and_the_filter_they_begin_with(scheme: dict[str, str]) -> None:
    asked = settings({"delay_ms": 300.0}, **AUTO, **scheme)
    assert coupling_of(asked, asked.users[0]).impedance_nspm == USUAL_NSPM
    assert not seat_settings(asked, 0).line.live


def test_by_default_impedance_follows_delay_and_device_and_there_is_no_filter() -> None:
    seat = seat_settings(settings(), 0)
    assert (seat.coupling.impedance_nspm, seat.line) == (USUAL_NSPM, LineTuning(auto_impedance=True))
    assert seat_settings(settings({"delay_ms": 300.0}), 0).coupling.impedance_nspm == pytest.approx(5.9, rel=0.02)


@pytest.mark.parametrize("carried", [8.2, 25.0])
def test_a_compensated_line_follows_the_device_alone(carried: float) -> None:
    """It needs all the impedance there is: the spring makes up for the delay."""
    seat = seat_settings(settings({"delay_ms": 30.0}, compensate=True, stiffness_npm=50.0), 0)
    assert seat.line.auto_impedance
    assert [seat.tuning_on(loop_s, carried).impedance_nspm for loop_s in (0.01, 0.6)] == [min(USUAL_NSPM, carried)] * 2
    begun = seat.at_impedance(min(USUAL_NSPM, carried))
    frames = begun.loop_s / begun.rates.frame_s
    assert begun.predicted_stiffness(frames) == pytest.approx(50.0)
    felt = 1.0 / (1.0 / begun.rendered_npm + begun.line_compliance(frames))
    assert felt == pytest.approx(50.0)


def test_the_digest_is_the_same_whatever_the_link() -> None:
    assert digest(settings({"delay_ms": 300.0}, **AUTO)) == digest(settings(**AUTO)) != digest(settings())
    assert digest(settings(**AUTO, prefer="light")) != digest(settings(**AUTO))


@pytest.mark.parametrize("corner", [0.0, LEAST_FILTER_HZ, 1000.0, "auto"])
def test_corners_within_bounds(corner: Any) -> None:
    assert settings(wave_filter_hz=corner).coupling.wave_filter_hz == corner


@pytest.mark.parametrize(
    ("coupling", "words"),
    [
        ({"wave_filter_hz": 0.9 * LEAST_FILTER_HZ}, "0.045 is below 0.05 Hz; give more, or 0 for no filter"),
        ({"wave_filter_hz": "none"}, 'expects a number from 0.0 to 1000.0 or "auto", in Hz; got'),
        ({"impedance_nspm": "automatic"}, 'expects a number from 0.001 to 10000.0 or "auto", in N s/m; got'),
        ({"prefer": "soft"}, 'prefer: expects "light", "balanced" or "stiff"; got'),
        ({**AUTO, "compensate": True}, "compensate = true needs a filter that stays as it is; give wave_filter_hz"),
        ({"wave_filter_hz": "auto", "compensate": True}, "needs a filter that stays as it is"),
    ],
)
def test_bad_input_says_what_to_do(coupling: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError) as error:
        settings(**coupling)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_a_person_s_own_keys_have_the_bounds_of_the_room_s() -> None:
    room, own = (get_type_hints(each, include_extras=True) for each in (CouplingSection, User))
    assert set(OWN_COUPLING) == set(room) & set(own) > {"impedance_nspm", "stiffness_npm"}
    for name in OWN_COUPLING:
        assert set(get_args(own[name])) - {type(None)} == set(get_args(room[name])) - {msgspec.UnsetType} or (
            own[name] == room[name] | None
        ), name
