"""Tests of whole sessions with unlike clocks and path delays, and of a felt stiffness that stays as asked whatever the delay
becomes (docs/decisions/0012-measured-delay.md).
"""

from collections.abc import Callable
from typing import Any

import pytest

from cogrip.client.recorder import RecordedClient
from cogrip.devices.simulated.hands import DirectedHand, ImpedanceSettings
from cogrip.protocol.settings.delays import line_delay
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.sections import Playout
from cogrip.results.report.tables import people_table
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory, LaboratoryPerson
from cogrip.sim.link import LinkEmulator

from tests.extent import long
from tests.sim.session_measures import FRAME_MS, Table, laboratory_of, least_margin

TICK_MS = 1000.0 / 1024.0


class OtherClock:
    """A client's core whose clock shows `clock(now_ns)`, in all that it is called with."""

    def __init__(self, core: RecordedClient, clock: Callable[[int], int]) -> None:
        self._core = core
        for name in ("receive", "sense", "act", "handle"):
            called = getattr(core, name)
            setattr(self, name, lambda *given, called=called: called(*given[:-1], clock(given[-1])))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._core, name)


def with_clock(person: LaboratoryPerson, clock: Callable[[int], int]) -> RecordedClient:
    """Give a person's client this clock from now on. Returns its core."""
    core = person.core
    person.core = OtherClock(core, clock)  # type: ignore[assignment]
    return core


# Clocks ------------------------------------------------------------------------------------------------------------------


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("ahead_s", "ppm", "up_frames", "down_ticks"),
    [
        long(0.0, 0.0, 1, 8),
        long(1000.0, 0.0, 2, 20),
        (-0.001, 300.0, 3, 4),
        (123.456, -300.0, 1, 40),
        (5e8, 100.0, 0, 12),
    ],
)
def test_both_ends_find_the_others_clock_up_to_half_the_difference_of_path_delays(
    ahead_s: float, ppm: float, up_frames: int, down_ticks: int
) -> None:
    link = {"up": {"delay_ms": up_frames * FRAME_MS}, "down": {"delay_ms": down_ticks * TICK_MS}}
    laboratory = laboratory_of(seconds=3.0, link=link)
    seat = laboratory.room.seats[0]
    core = with_clock(laboratory.people[0], lambda now_ns: now_ns + int(ahead_s * 1e9) + int(now_ns * ppm * 1e-6))
    laboratory.run()
    delay = of_laboratory(laboratory)["users"][0]["delay"]
    up_ms, down_ms = up_frames * FRAME_MS, down_ticks * TICK_MS
    wrong_ms = 0.5 * (up_ms - down_ms)  # no stamp shows it
    ahead_ms = ahead_s * 1e3 + 3.0e3 * ppm * 1e-6
    slack_ms = 1e-4 + 2e-8 * abs(ahead_ms) + 0.02 * abs(ppm) / 300.0
    assert delay["clock_offset_ms"] == pytest.approx(-ahead_ms + wrong_ms, abs=slack_ms)
    assert delay["uncertainty_ms"] == pytest.approx(0.5 * (up_ms + down_ms), abs=slack_ms)
    for direction in ("up_ms", "down_ms"):
        assert delay[direction]["p50"] == pytest.approx(0.5 * (up_ms + down_ms), rel=1 / 31)  # of a histogram's bin
    assert seat.clock.offset_ns * 1e-6 == pytest.approx(ahead_ms - wrong_ms, abs=slack_ms)
    assert core.session.clock.contradictions == seat.clock.contradictions == 0


def test_through_jitter_loss_repetition_and_disorder_the_clock_is_found_within_what_is_said() -> None:
    link = {"delay_ms": 15.0, "jitter_ms": 10.0, "loss": 0.3, "burst_frames": 4.0, "duplicate": 0.2, "reorder": 0.2}
    laboratory = laboratory_of(seconds=6.0, link=link, playout={"frames": 4})
    ahead_ns = 77 * 10**9
    core = with_clock(laboratory.people[0], lambda now_ns: now_ns + ahead_ns + now_ns // 5000)  # 200 ppm
    wrong_ms = []

    def look(laboratory: Laboratory) -> None:
        clock = core.session.clock
        if clock.offset_ns is not None and laboratory.seconds > 1.0:
            truth_ns = -ahead_ns - laboratory.now_ns // 5000
            assert abs(clock.offset_ns - truth_ns) <= clock.uncertainty_ns + 1_000_000  # it was read up to a frame ago
            wrong_ms.append(abs(clock.offset_ns - truth_ns) * 1e-6)

    laboratory.run(each_frame=look)
    assert max(wrong_ms) < 6.0
    delay = of_laboratory(laboratory)["users"][0]["delay"]
    assert 15.0 < delay["down_ms"]["p50"] < delay["down_ms"]["p99"]
    assert 15.0 < delay["up_ms"]["p50"] < delay["up_ms"]["p99"]
    assert "implausible stamp" not in {*core.session.dropped, *laboratory.server.dropped}


# The spring --------------------------------------------------------------------------------------------------------------

K_NPM = 1000.0
PRESS_S, CYCLE_S = 3.25, 4.0
MEAN_S = 0.5  # of what is felt: a long line rings


def course(sign: float, stroke_s: float = 0.4) -> Callable[[float], tuple[float, float]]:
    """Press 6 mm in, hold, draw back 4 mm out, and again."""
    speed_mps = 0.010 / stroke_s

    def at(time_s: float) -> tuple[float, float]:
        phase_s = time_s % CYCLE_S
        if phase_s < stroke_s:
            return sign * (-0.004 + speed_mps * phase_s), sign * speed_mps
        if phase_s < PRESS_S:
            return sign * 0.006, 0.0
        if phase_s < PRESS_S + stroke_s:
            return sign * (0.006 - speed_mps * (phase_s - PRESS_S)), -sign * speed_mps
        return sign * -0.004, 0.0

    return at


class Felt:
    """A session whose link changes its delay; what every hand felt at the end of each pressing."""

    def __init__(
        self,
        kind: str,
        axes: int,
        delays: list[tuple[float, float]],
        seconds: float,
        stroke_s: float = 0.4,
        device_hz: int = 512,
        **tables: Table,
    ) -> None:
        people = 1 if kind == "wall" else 2
        users = [
            {"name": f"u{number}", "device": "sim:ideal", "device_mass_kg": 0.2, "side": "right" if number else "left"}
            for number in range(people)
        ]
        coupling = {"impedance_nspm": 60.0, "stiffness_npm": K_NPM, "compensate": True, **tables.pop("coupling", {})}
        thing, link = {"kind": kind, "axes": axes, "damping_nspm": 5.0}, {"delay_ms": delays[0][1]}
        rates = {"device_hz": device_hz}
        self.laboratory = laboratory_of(
            seconds=seconds, rates=rates, object=thing, coupling=coupling, users=users, link=link, **tables
        )
        for number, person in enumerate(self.laboratory.people):
            hand = DirectedHand(
                ImpedanceSettings(hand_stiffness_npm=500.0, hand_damping_nspm=10.0),
                course(-1.0 if number else 1.0, stroke_s),
                (1.0, *[0.5] * (axes - 1)) if kind != "wall" else (1.0, *[0.0] * (axes - 1)),
            )  # fmt: skip
            hand.open(device_hz, (0.0,) * axes)
            person.device.hand = hand
        self.felt_npm: list[float] = []
        self._pressed: list[tuple[float, float]] = []
        self._delays = delays[1:]
        self.laboratory.run(each_frame=self._frame)
        self.summary = of_laboratory(self.laboratory)

    def _frame(self, laboratory: Laboratory) -> None:
        if self._delays and laboratory.seconds >= self._delays[0][0]:
            (_, delay_ms), *self._delays = self._delays
            for person in laboratory.people:
                reroute(person, delay_ms, laboratory.seconds)
        if PRESS_S - MEAN_S < (phase_s := laboratory.seconds % CYCLE_S) <= PRESS_S:
            one, *other = laboratory.people
            depth = one.core.position_m[0] - (other[0].core.position_m[0] if other else 0.0)
            springs = 2.0 if other else 1.0  # one after the other
            self._pressed.append((springs * one.core.force_n[0], depth))
            if abs(phase_s - PRESS_S) < 1e-9:
                forces, depths = zip(*self._pressed, strict=True)
                self.felt_npm.append(sum(forces) / sum(depths))
                self._pressed = []


def reroute(person: LaboratoryPerson, delay_ms: float, seconds: float) -> None:
    """Change the network path: datagrams under way on the old one are lost."""
    person.up = LinkEmulator(LinkProfile(delay_ms=delay_ms), f"{person.name}/up/{seconds}")
    person.down = LinkEmulator(LinkProfile(delay_ms=delay_ms), f"{person.name}/down/{seconds}")


@pytest.mark.parametrize(
    ("kind", "axes", "before_ms", "after_ms"),
    [
        long("wall", 1, 20.0, 40.0),
        long("wall", 1, 40.0, 20.0),
        long("wall", 3, 20.0, 40.0),
        long("cube", 2, 20.0, 40.0),
        long("cube", 3, 20.0, 40.0),
        long("cube", 3, 40.0, 20.0),
        ("faces", 1, 40.0, 20.0),
    ],
)
def test_the_stiffness_is_felt_as_asked_before_and_after_the_delay_changes(
    kind: str, axes: int, before_ms: float, after_ms: float
) -> None:
    """The jitter buffer takes up to 4 s to follow, and so does the loop. Then the spring does."""
    device_hz = 1024 if axes == 3 else 512  # at the lower rate three axes are not at rest in time
    session = Felt(kind, axes, [(0.0, before_ms), (3.5, after_ms)], 11.3, device_hz=device_hz)
    felt, summary = session.felt_npm, session.summary
    assert felt[0] == pytest.approx(K_NPM, rel=0.01)
    assert felt[-1] == pytest.approx(K_NPM, rel=0.02)
    assert summary["passive"]
    assert not any(summary[key] for key in ("unstable", "saturated", "left"))
    assert least_margin(summary) >= -1e-12
    assert summary["server"]["energy_balance_error_j"] < 1e-12
    way = line_delay(Playout(), LinkProfile(delay_ms=after_ms), Rates(device_hz, 128))
    for user, person in zip(summary["users"], session.laboratory.people, strict=True):
        loop, least = person.core.coupling.loop_frames(), 2.0 * way.frames + 1.0
        assert least <= loop <= least + 2.0 / way.ticks_per_frame, "two ticks are not chased"
        compliance = loop * FRAME_MS * 1e-3 / 120.0
        assert user["rendered_npm"] == pytest.approx(K_NPM / (1.0 - K_NPM * compliance), rel=1e-9)
        # what the line owes since the playout delay has changed is in it
        assert user["predicted_stiffness_npm"] == pytest.approx(K_NPM, rel=0.01)


@pytest.mark.long
def test_without_compensation_the_spring_is_the_one_that_was_asked_for_and_the_prediction_follows_the_loop() -> None:
    session = Felt("wall", 1, [(0.0, 20.0), (3.5, 40.0)], 11.3, coupling={"compensate": False})
    [user] = session.summary["users"]
    assert user["rendered_npm"] == K_NPM
    ways = [line_delay(Playout(), LinkProfile(delay_ms=delay_ms), Rates(512, 128)) for delay_ms in (20.0, 40.0)]
    before, after = 2 * ways[0].frames + 1, session.laboratory.people[0].core.coupling.loop_frames()
    assert after == pytest.approx(2 * ways[1].frames + 1, abs=0.5)
    compliances = [1.0 / K_NPM + loop * FRAME_MS * 1e-3 / 120.0 for loop in (before, after)]
    assert session.felt_npm[0] == pytest.approx(1.0 / compliances[0], rel=0.01)
    assert session.felt_npm[-1] == pytest.approx(1.0 / compliances[1], rel=0.02)
    assert user["predicted_stiffness_npm"] == pytest.approx(1.0 / compliances[1], rel=1e-9)
    assert session.laboratory.room.seats[0].adapter is None


@pytest.mark.long
def test_a_delay_that_puts_the_stiffness_out_of_reach_is_said_and_the_hand_feels_what_the_line_allows() -> None:
    session = Felt("wall", 1, [(0.0, 20.0), (3.5, 60.0)], 15.3, stroke_s=1.2, device_hz=1024)
    [user] = session.summary["users"]
    loop_s = (2 * 62 + 8 + 1) * TICK_MS * 1e-3  # 60 ms are 62 ticks; one more is not chased
    line_npm = 120.0 / loop_s  # 923.9: softer than what is asked for
    assert user["rendered_npm"] == pytest.approx(100.0 * K_NPM)
    assert session.felt_npm[-1] == pytest.approx(1.0 / (1e-2 / K_NPM + 1.0 / line_npm), rel=0.02)
    told = [event.text for event in session.laboratory.server.events if event.event == "stiffness"]
    assert len(told) == 1
    assert "u0 is told: a felt stiffness of 1000 N/m is out of reach by the delay now measured (1" in told[0]
    enough = float(told[0].partition("coupling.impedance_nspm above ")[2].partition(" ")[0])
    assert enough == pytest.approx(0.5 * K_NPM * loop_s, rel=0.06)  # told before the frames' phase is at rest
    assert least_margin(session.summary) >= -1e-12


@pytest.mark.long
def test_a_playout_that_finds_its_own_depth_is_part_of_what_is_measured() -> None:
    session = Felt("wall", 1, [(0.0, 15.0), (3.5, 30.0)], 11.3, playout={"frames": "auto"})
    [user] = session.summary["users"]
    loop = session.laboratory.people[0].core.coupling.loop_frames()
    compliance = loop * FRAME_MS * 1e-3 / 120.0
    assert user["rendered_npm"] == pytest.approx(K_NPM / (1.0 - K_NPM * compliance), rel=1e-9)
    table = people_table(session.summary)
    assert not isinstance(table, str)
    cells = {row.label: (row.unit, row.cells[0].text) for row in table.rows if not isinstance(row, str)}
    directions = " / ".join(f"{user['delay'][direction]['p50']:.1f}" for direction in ("up_ms", "down_ms"))
    assert cells["one way, median"] == ("ms", directions)
    assert cells["rendered stiffness"] == ("N/m", f"{user['rendered_npm']:.0f}")
    assert session.felt_npm[-1] == pytest.approx(K_NPM, rel=0.02)
    assert least_margin(session.summary) >= -1e-12
