"""Limit and weight of a hand, by themselves."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.hand.frame import HandFrame
from cogrip.client.sources.force_source import AtHand
from cogrip.client.sources.hand_aids import HandAids
from cogrip.devices.device import GRAVITY_MPS2
from cogrip.protocol.settings.hand import NO_LIMIT, HandChange

from tests.client.seated_client import capability

HANDLE_KG = 0.1


@given(st.lists(st.tuples(st.booleans(), st.floats(-0.1, 0.1)), min_size=1, max_size=40))
def test_what_a_carried_weight_has_taken_is_a_function_of_the_height(steps: list[tuple[bool, float]]) -> None:
    """Also of one that is carried up and not down: else a hand would be lifted for nothing, again and again."""
    record = replace(capability(3), handle_mass_kg=HANDLE_KG)
    aids, first_m = HandAids(NO_LIMIT, False, record, 1.0 / 1024), None
    for carried, height_m in steps:
        aids.change(HandChange(gravity_compensation=carried))
        aids.force(AtHand(0, (0.0, 0.0, height_m), (0.0, 0.0, 0.0), HandFrame(), 1.0, 20.0, 1e3))
        if carried:
            first_m = height_m if first_m is None else first_m
            taken_j = HANDLE_KG * GRAVITY_MPS2 * (height_m - first_m)
            assert aids.potential_j == pytest.approx(taken_j, abs=1e-12)
