"""Three axes, which the tick of a client takes without loops, and their general form: the same recordings, bit for bit."""

from pathlib import Path

import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.recording.sink import Held
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.interpreted import needs_interpreted, source_of

UNROLLED = (
    "cogrip.client.safety.force_limits", "cogrip.client.seat.hand_motion", "cogrip.client.safety.limiter",
    "cogrip.client.hand.velocity",
    "cogrip.client.coupling.wave_coupling", "cogrip.devices.plausibility", "cogrip.devices.simulated.ideal",
    "cogrip.devices.simulated.waypoints", "cogrip.protocol.laws.decimation", "cogrip.protocol.line.energy_sums",
)  # fmt: skip
"""Modules that take PLACES axes without a loop."""


def recorded(settings: str, changes: list[str]) -> list[list[tuple[int, int, bytes]]]:
    """Return the messages of each end's recording."""
    sinks: list[Held] = []

    def record(core: object, who: str) -> Held:
        sinks.append(Held())
        return sinks[-1]

    Laboratory(load(Path(settings), changes), record).run()
    return [sink.messages for sink in sinks]


@pytest.mark.parametrize("name", UNROLLED)
def test_each_names_the_number_of_axes_that_it_takes_without_a_loop(name: str) -> None:
    assert "== PLACES" in source_of(name).read_text()


@pytest.mark.long
@needs_interpreted
@pytest.mark.parametrize(
    ("settings", "changes"),
    [("lift", ["seconds=1"]), long("demo", ["seconds=2", "object.axes=3", "link.loss=0.05"])],
)
def test_three_axes_are_as_any_number(settings: str, changes: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    without_loops = recorded(settings, changes)
    for name in UNROLLED:
        monkeypatch.setattr(f"{name}.PLACES", 99)
    assert recorded(settings, changes) == without_loops
