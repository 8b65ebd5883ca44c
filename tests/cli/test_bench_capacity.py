"""The model of `bench capacity`, put back by hand."""

import msgspec
import pytest

from tests.bench.capacity import BUSY, DIRECTORY_BUSY, HOST_CORES, MOST, NAMES, Parts, directory_load, model

PARTS = Parts(106.25, 19.0, 19.53125, 2500.0, 586.0, 25e3, 1.5, 0.08, 2.0)


def test_each_part_has_a_name() -> None:
    assert tuple(NAMES) == Parts.__struct_fields__


def test_a_core_and_a_host_carry_what_fits_into_their_part_of_a_frame() -> None:
    core, workers, one, ten, hundred, most, clusters = model(PARTS)
    assert core.people == (BUSY * 7812.5 - 106.25) // 19.0 == 200
    recorder = 200 * 19.53125 / 7812.5
    assert recorder == 0.5
    assert workers.people == 200 * (HOST_CORES - 1) // 1.5 == 2000
    assert one.people == 2 * ((HOST_CORES - 1) * BUSY * 7812.5 // 586.0) == 198
    assert (ten.people, hundred.people) == (1980, 19_800)
    assert most.directory <= DIRECTORY_BUSY < directory_load(PARTS, most.people // 198 + 1, 198)
    assert clusters.people == MOST
    assert int(clusters.what.split()[0]) == -(-MOST // most.people)


def test_the_directory_takes_a_straight_part_for_reports_and_a_square_one_for_looks_and_fronts() -> None:
    assert directory_load(PARTS, 1, 2000) == pytest.approx(1000 * (1.5 * 4 + 0.08 * 9 + 2.0 * 5) * 1e-6)
    assert directory_load(PARTS, 10, 2000) == pytest.approx(10_000 * (1.5 * 4 + 0.08 * 90 + 2.0 * 50) * 1e-6)


def test_who_computes_twice_as_fast_carries_twice_as_many() -> None:
    slow, fast = (msgspec.structs.replace(PARTS, frame=0.0, person=each) for each in (20.0, 10.0))
    assert model(fast)[0].people == 2 * model(slow)[0].people  # 390 and 195, of 390.6 and 195.3
    assert model(msgspec.structs.replace(PARTS, frame=-5.0)) == model(msgspec.structs.replace(PARTS, frame=0.0))
