"""A sample is a value: equal by its fields, and never changed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices import device
from cogrip.devices.sample import FIELDS, Sample

VALUES = st.fixed_dictionaries(
    {
        "position_m": st.tuples(st.floats(allow_nan=False)),
        "velocity_mps": st.none() | st.tuples(st.floats(allow_nan=False)),
        "age_ticks": st.integers(0, 3),
        "buttons": st.integers(0, 3),
        "orientation": st.none() | st.just((1.0, 0.0, 0.0, 0.0)),
        "grip_m": st.none() | st.floats(0.0, 0.1),
    }
)


def test_drivers_find_it_beside_their_interface() -> None:
    assert device.Sample is Sample


@given(VALUES, VALUES)
def test_samples_are_equal_where_all_fields_are(one: dict[str, object], other: dict[str, object]) -> None:
    first, second = Sample(**one), Sample(**other)  # type: ignore[arg-type]
    assert (first == second) is (one == other)
    assert first.replaced(**other) == second
    assert hash(first) == hash(Sample(**one))  # type: ignore[arg-type]
    assert {name: getattr(first.replaced(), name) for name in FIELDS} == one


def test_a_sample_tells_its_fields() -> None:
    text = repr(Sample((0.5,), None, buttons=2))
    assert text == "Sample(position_m=(0.5,), velocity_mps=None, age_ticks=0, buttons=2, orientation=None, grip_m=None)"
    assert Sample((0.5,), None) != (0.5,)
    with pytest.raises(TypeError):
        Sample((0.5,), None).replaced(position=(0.5,))
