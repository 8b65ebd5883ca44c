"""`openhaptics:`: which model it is, by address and by what the library says, and what that allows."""

import ctypes
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices.device import DeviceError
from cogrip.devices.openhaptics.models import RECORDS, Facts, lowered, model_of

from tests.devices.openhaptics_bench import RATE_HZ


@pytest.mark.parametrize(
    ("said", "model"),
    [
        ("Touch", "touch"), ("Geomagic Touch", "touch"), ("Touch X", "desktop"), ("PHANTOM Omni", "omni"),
        ("PHANTOM Desktop", "desktop"), ("PHANTOM Premium 1.0", "premium1.0"),
        ("PHANTOM Premium 1.5 6DOF", "premium1.5"), ("PHANTOM Premium 3.0 6DOF", "premium3.0"), ("Falcon", None),
        ("", None),
    ],
)  # fmt: skip
def test_models_by_what_they_call_themselves(said, model) -> None:
    assert model_of(said) == model


@given(peak=st.floats(0.01, 50.0), continuous=st.floats(0.01, 50.0), stiffness=st.floats(0.001, 1.0))
def test_a_device_can_only_lower_its_record(peak, continuous, stiffness) -> None:
    for record in RECORDS.values():
        low = lowered(record, Facts("Touch", peak, continuous, stiffness), "", "here")
        assert low.peak_force_n == min(record.peak_force_n, peak)
        assert low.continuous_force_n == min(record.continuous_force_n, continuous, low.peak_force_n)
        assert low.stiffness_npm == min(record.stiffness_npm, 1000.0 * stiffness)


@pytest.mark.parametrize(
    ("said", "keys", "words"),
    [
        ("PHANTOM Omni", "&model=touch", "that is model=omni, not touch; correct the key model"),
        ("Falcon", "", "calls itself 'Falcon', which is not known; known are touch, omni"),
        ("Falcon", "&model=touch", "which is not known"),
    ],
)
def test_another_model_is_refused(bench, said, keys, words) -> None:
    bench.lib.stub_model(0, said.encode(), ctypes.c_double(3.3), ctypes.c_double(0.88), ctypes.c_double(0.5))
    with pytest.raises(DeviceError, match=words):
        bench.opened(keys=keys)
    assert "enable Default Device" not in bench.journal()


@pytest.mark.parametrize("bad", [(0.0, 0.88, 0.5), (3.3, -1.0, 0.5), (3.3, 0.88, nan), (inf, 0.88, 0.5)])
def test_limits_that_are_none_are_refused(bench, bad) -> None:
    bench.lib.stub_model(0, b"Touch", *map(ctypes.c_double, bad))
    with pytest.raises(DeviceError, match=r"the library states a largest .*not above 0"):
        bench.opened()


def test_limits_are_lowered_at_open_and_hold(bench) -> None:
    bench.lib.stub_model(0, b"PHANTOM Premium 1.5", ctypes.c_double(6.0), ctypes.c_double(9.0), ctypes.c_double(0.6))
    device = bench.device(keys="&model=premium1.5")
    assert (device.capability.peak_force_n, device.capability.stiffness_npm) == (8.5, 800.0)
    device.open(RATE_HZ)
    record = device.capability
    assert (record.peak_force_n, record.continuous_force_n, record.stiffness_npm) == (6.0, 1.4, 600.0)
    device.write((8.0, 0.0, 0.0))
    bench.step()
    assert bench.force() == (0.0, 0.0, -6.0)
    device.close()


def test_model_that_is_not_stated_has_the_limits_of_the_weakest(bench) -> None:
    bench.lib.stub_model(0, b"PHANTOM Premium 3.0", ctypes.c_double(22.0), ctypes.c_double(3.0), ctypes.c_double(1.0))
    device = bench.opened()
    assert device.capability.peak_force_n == 3.3
    device.close()
