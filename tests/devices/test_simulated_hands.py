"""Hands: motions that are what they say, and recordings played as they were recorded."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.devices import DeviceError, make
from cogrip.devices.simulated.hands import (
    ReachSettings,
    SineSettings,
    TremorSettings,
    reach_course,
    sine_course,
    tremor_course,
)  # fmt: skip
from cogrip.devices.simulated.recorded_hand import read_recording
from cogrip.devices.simulated.recorded_settings import RecordedSettings

from tests.devices.held_device import hold, opened, refused

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"

RECORDINGS = {
    "tue_1dof_PP_kp8.csv": ("time=t_s&x=theta_m_rad&scale=0.075&where=run:spring", 1),
    "tue_1dof_PF_kp15.csv": ("time=t_s&x=theta_m_rad&scale=0.075&where=run:foam2", 1),
    "touch_freehand_wpi_100hz.csv": ("time=t_s&x=px_mm&y=py_mm&z=pz_mm&scale=0.001", 3),
    "panda_handguided_symbol17_rec0_2_4.csv": ("time=i&time_scale=0.001&where=rec:0&x=px_m&y=py_m&z=pz_m", 3),
    "pen_wacom_bdalab_133hz.csv": ("time=t_s&x=x_mm&y=y_mm&scale=0.001", 2),
}


def data_file(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"no recording {name} in {DATA}")
    return path


SINE = sine_course(SineSettings(amplitude_m=0.01, frequency_hz=2.0, ramp_s=0.5, offset_m=0.002))
REACH = reach_course(ReachSettings(amplitude_m=0.03, stroke_s=0.8, stop_s=1.5))


@given(
    amplitude=st.floats(-0.1, 0.1),
    stroke=st.floats(0.1, 3.0),
    delay=st.floats(0.0, 2.0),
    strokes=st.integers(0, 6),
    time=st.floats(0.0, 20.0),
)
@settings(deadline=None)
def test_reach_velocity_is_the_slope_and_the_end_is_rest(amplitude, stroke, delay, strokes, time) -> None:
    stop = delay + strokes * stroke
    reach = ReachSettings(amplitude_m=amplitude, stroke_s=stroke, delay_s=delay, stop_s=stop)
    course = reach_course(reach)
    step = 1e-5 * stroke
    slope = (course(time + step)[0] - course(time - step)[0]) / (2 * step)
    assert course(time)[1] == pytest.approx(slope, abs=1e-6 * (1 + abs(amplitude / stroke)))
    assert course(delay) == (0.0, 0.0)
    assert course(stop + 1e-9 * stop + 1e-12) == (amplitude if strokes % 2 else 0.0, 0.0)


@given(st.floats(-0.05, 0.05), st.floats(0.05, 20.0), st.floats(0.0, 2.0), st.floats(-0.05, 0.05), st.floats(0.0, 5.0))
def test_sine_velocity_is_the_slope(amplitude, frequency, ramp, offset, time) -> None:
    course = sine_course(SineSettings(amplitude_m=amplitude, frequency_hz=frequency, ramp_s=ramp, offset_m=offset))
    if abs(time - ramp) < 1e-5 or time < 1e-5:
        return
    (before, _), (_, speed), (after, _) = (course(time + step) for step in (-1e-6, 0.0, 1e-6))
    assert speed == pytest.approx((after - before) / 2e-6, abs=1e-5)


def test_reach_rests_after_each_stroke() -> None:
    course, plain = (reach_course(ReachSettings(amplitude_m=0.03, stroke_s=0.8, rest_s=still)) for still in (0.4, 0.0))
    for time in (0.1, 0.4, 0.79):
        assert course(time) == pytest.approx(plain(time))
        assert course(1.2 + time) == pytest.approx(plain(0.8 + time))
    for time in (0.8, 1.19):
        assert course(time) == pytest.approx((0.03, 0.0))
        assert course(1.2 + time) == pytest.approx((0.0, 0.0), abs=1e-15)
    last = reach_course(ReachSettings(amplitude_m=0.03, stroke_s=0.8, rest_s=0.4, stop_s=2.0))
    assert last(1.6)[1] < 0.0, "the second stroke is over by stop_s"
    assert last(5.0) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("course", "time_s", "expected"),
    [
        (SINE, 0.0, (0.0, 0.0)),
        (SINE, 1.125, (0.012, 0.0)),
        (SINE, 1.375, (-0.008, 0.0)),
        (REACH, 0.4, (0.015, 1.875 * 0.03 / 0.8)),
        (REACH, 0.8, (0.03, 0.0)),
        (REACH, 1.5, (0.03, 0.0)),  # the way back would not be over by stop_s
    ],
)
def test_a_hand_goes_to_and_fro(course, time_s: float, expected: tuple[float, float]) -> None:
    assert course(time_s) == pytest.approx(expected, abs=1e-12)


def test_tremor_lies_in_its_band_and_has_its_size() -> None:
    course = tremor_course(TremorSettings(tremor_m=0.001, seed=7))
    rate, seconds = 200, 60
    x = np.array([course(k / rate)[0] for k in range(rate * seconds)])
    power = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
    hz = np.fft.rfftfreq(len(x), 1 / rate)
    assert power[(hz > 7.9) & (hz < 12.1)].sum() > 0.999 * power.sum()
    assert x.std() == pytest.approx(0.001, rel=0.05)
    assert course(1.0) != tremor_course(TremorSettings(tremor_m=0.001, seed=8))(1.0)


def test_direction_scales_each_axis_and_home_is_the_start() -> None:
    device = opened("sim:ideal?hand=reach&direction=1,0.5&x0_m=0.1,0,-0.1", axes=3, rate_hz=1000)
    position, velocity = device.hand.intended(400)
    assert position == pytest.approx((0.115, 0.0075, -0.1))
    assert velocity == pytest.approx((velocity[0], velocity[0] / 2, 0.0))


def test_push_is_a_pure_force_from_its_start_on() -> None:
    device = opened("sim:ideal?hand=push&force_n=2&start_s=0.5", rate_hz=1000)
    device.read(500)
    assert device.position_m == (0.0,)
    device.read(600)
    assert device.position_m[0] == pytest.approx(0.5 * 2 / 0.1 * 0.1**2, rel=1e-9)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", RECORDINGS)
def test_real_recordings_load_and_play(name: str) -> None:
    keys, axes = RECORDINGS[name]
    device, ticks = opened(f"sim:ideal?hand=csv:{data_file(name)}&{keys}", axes), 1024 * 4
    moved = np.ptp([sample.position_m for sample in hold(device, ticks)], axis=0)
    intended = np.ptp([device.hand.intended(k)[0] for k in range(ticks)], axis=0)
    assert np.all(moved <= 1.3 * intended + 1e-3)
    assert np.all(moved >= 0.7 * intended - 1e-3)


def test_intended_motion_is_the_recording_at_its_samples() -> None:
    """TU/e is recorded at 2000 Hz: at that loop rate every tick is a sample."""
    path = data_file("tue_1dof_PP_kp8.csv")
    keys, _ = RECORDINGS[path.name]
    lines = [line.split(",") for line in path.read_text().splitlines() if line.startswith("spring,")]
    recorded = [0.075 * float(cells[2]) for cells in lines]
    for origin, offset in (("keep", 0.0), ("start", recorded[0])):
        device = opened(f"sim:ideal?hand=csv:{path}&{keys}&origin={origin}", rate_hz=2000)
        played = [device.hand.intended(k)[0][0] for k in range(len(recorded))]
        assert played == pytest.approx([x - offset for x in recorded], abs=1e-8)
        assert device.hand.intended(10**6) == ((pytest.approx(recorded[-1] - offset),), (0.0,))


def test_interpolation_passes_through_uneven_samples() -> None:
    keys = RecordedSettings(time="t_s", x="px_mm", y="py_mm", z="pz_mm", scale=0.001)
    recording = read_recording(str(data_file("touch_freehand_wpi_100hz.csv")), keys, 3)
    assert recording.position_m.shape == (2743, 3)
    assert recording.at(recording.time_s)[0] == pytest.approx(recording.position_m, abs=1e-15)
    middle = (recording.time_s[1:] + recording.time_s[:-1]) / 2
    low = np.minimum(recording.position_m[1:], recording.position_m[:-1])
    high = np.maximum(recording.position_m[1:], recording.position_m[:-1])
    between = recording.at(middle)[0]
    assert np.all((between >= low - 1e-12) & (between <= high + 1e-12))


SMALL = "run,t,x,note\na,0,1,\na,0.5,2,\na,1.0,4,\nb,0,7,\nb,1,8,\nc,0,1,\nd,0,abc,\nd,1,2,\ne,0,1\ne,0,2\n"


def small(tmp_path: Path, text: str = SMALL) -> Path:
    file = tmp_path / "a b?=.csv"
    file.write_text(text)
    return file


def test_start_and_loop(tmp_path: Path) -> None:
    keys = "time=t&x=x&where=run:a&scale=0.01&start_s=0.1&loop=1"
    device = opened(f"sim:ideal?hand=csv:{small(tmp_path)}&{keys}", rate_hz=1000)
    at = [device.hand.intended(10 * k)[0][0] for k in range(500)]
    assert at[:11] == [0.0] * 11
    assert device.hand.intended(50)[1] == (0.0,)
    assert at[60] == pytest.approx(0.01)
    assert at[110] == pytest.approx(0.03)
    assert at[160] == pytest.approx(0.015)  # half of the way back
    assert at[210:310] == at[10:110]
    assert np.abs(np.diff(at)).max() < 0.001


def test_kept_origin_starts_the_device_there(tmp_path: Path) -> None:
    keys = "time=t&x=x&where=run:a&scale=0.01"
    address = f"sim:phantom?hand=csv:{small(tmp_path)}&{keys}&origin=keep"
    assert opened(address).position_m == (0.01,)
    with pytest.raises(DeviceError, match="origin=start"):
        opened(address.replace("0.01", "1"))


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("time=tt&x=x", ["'tt'", "did you mean 't'", "run, t, x, note"]),
        ("time=t&x=y", ["'y'", "run, t, x, note"]),
        ("time=t&x=x&where=ran:a", ["'ran'", "did you mean 'run'"]),
        ("time=t&x=x&where=run", ["column:value"]),
        ("time=t&x=x&where=run:f", ["keeps no row", "'f'", "a, b, c, d, e"]),
        ("time=t&x=x&where=run:c", ["1 usable row", "at least 2"]),
        ("time=t&x=x&where=run:d", ["line 8", "x='abc'"]),
        ("time=t&x=note&where=run:a", ["line 2", "note=''"]),
        ("time=t&x=note&where=run:e", ["line 10", "note=''"]),
        ("time=t&x=t", ["line 5", "t=0.0", "after 1.0", "where=column:value"]),
        ("time=t&x=x&where=run:e", ["line 11", "t=0.0"]),
    ],
)
def test_bad_recording_says_where_and_what_to_do(tmp_path: Path, keys: str, said: list[str]) -> None:
    device = make(f"sim:ideal?hand=csv:{small(tmp_path)}&{keys}")
    with refused(*said):
        device.open(1000)


def test_missing_and_binary_files_are_errors(tmp_path: Path) -> None:
    binary = tmp_path / "binary.csv"
    binary.write_bytes(bytes(range(256)))
    empty = [small(tmp_path, text).rename(tmp_path / f"{k}.csv") for k, text in enumerate(("", "t,x\n", "\n\n"))]
    for path in (tmp_path / "missing.csv", tmp_path, binary, *empty):
        with pytest.raises(DeviceError, match="csv hand" if path in empty else "cannot read"):
            opened(f"sim:ideal?hand=csv:{path}&time=t&x=x")
