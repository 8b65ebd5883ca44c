"""Time of a room's frame, by a clock of the test: what is timed, how long it takes, and the rate that is chosen by it."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from cogrip.cli.session.network_rate import RateChoices, stated
from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped_scene
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS
from cogrip.protocol.settings.network_rate import OUTSIDE_S, PERSON_S, RATES_HZ, SERVER_SHARE, RateChoice
from cogrip.protocol.settings.room import best_network_hz, for_remote_clients, resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.server.checkpoint import encode
from cogrip.server.io.checkpoint_file import CheckpointWriter
from cogrip.server.io.state_folder import make_folder
from cogrip.server.room import Room
from cogrip.sim import frame_cost as module
from cogrip.sim.frame_cost import PAUSE_NS, SPENT_NS, WARM, frame_cost

from tests.kinds import SCHEMES, objects_of


class VirtualClock:
    """A clock that goes on by `step_ns` whenever it is read, and to where it is waited for. One reading may be slow."""

    def __init__(self, step_ns: int, slow: int = 0) -> None:
        self.now_ns, self.reads, self._step_ns, self._slow = 0, 0, step_ns, slow

    def read(self) -> int:
        self.reads += 1
        self.now_ns += 50_000_000 if self.reads == self._slow else self._step_ns
        return self.now_ns

    def wait(self, until_ns: int) -> None:
        self.now_ns = max(self.now_ns, until_ns)


def room(kind: str, **tables: object) -> Settings:
    lift = {"kind": "scene", "file": str(shipped_scene("lift.xml"))}
    things: dict[str, dict[str, object]] = {
        "cube": {"kind": "cube", "axes": 3},
        "scene": lift | {"axes": 3},
        "poses": lift | {"axes": 6},
    }
    tool = "ball" if kind in ("scene", "poses") else ""
    users = [{"name": name, "side": side, "tool": tool} for name, side in (("anna", "left"), ("ben", "right"))]
    return resolve({"object": things.get(kind, {"kind": kind}), "users": users, **tables})


@pytest.fixture
def rooms(monkeypatch: pytest.MonkeyPatch) -> list[Room]:
    """Rooms that are timed from now on."""
    made: list[Room] = []
    monkeypatch.setattr(module, "Room", lambda settings: made.append(Room(settings)) or made[-1])
    return made


@pytest.mark.parametrize(
    ("kind", "coupling"),
    [
        (thing, scheme)
        for scheme in SCHEMES
        for traits in [COUPLING_KINDS[scheme]]
        for thing in (*objects_of(scheme), "scene", *["poses"] * traits.waves)
    ],
)
def test_the_rooms_own_frame_is_timed_with_everybody_holding_on(kind: str, coupling: str, rooms: list[Room]) -> None:
    clock = VirtualClock(2_000_000)
    cost = frame_cost(room(kind, coupling={"kind": coupling}), clock.read, clock.wait)
    (timed,) = rooms
    assert cost.frame_s == pytest.approx(2e-3)
    assert timed.steps == cost.frames + WARM
    assert all(seat.on_object for seat in timed.seats)
    assert all(seat.port is not None and seat.port.count().applied >= cost.frames // 2 for seat in timed.seats)
    assert not timed.unstable
    assert not timed.left
    assert timed.world.holding.all()


@pytest.mark.parametrize("step_ns", [1_000, 1_000_000, 60_000_000])
def test_it_takes_a_bounded_time_whatever_a_frame_takes(step_ns: int) -> None:
    clock = VirtualClock(step_ns)
    cost = frame_cost(room("cube"), clock.read, clock.wait)
    assert cost.frames >= 1
    assert clock.now_ns <= SPENT_NS + 4 * step_ns + 2 * PAUSE_NS
    assert clock.now_ns <= 300_000_000 or step_ns > 10_000_000


def test_one_slow_frame_does_not_count() -> None:
    clock = VirtualClock(100_000, slow=20)
    assert frame_cost(room("cube"), clock.read, clock.wait).frame_s == pytest.approx(1e-4)
    assert clock.reads > 20


def choose(frame_us: float) -> Callable[[Settings], RateChoice]:
    """Return the choice on a machine where a frame takes this long."""

    def found(settings: Settings) -> RateChoice:
        clock = VirtualClock(round(1e3 * frame_us))
        cost = frame_cost(settings, clock.read, clock.wait)
        frame_s = cost.frame_s + OUTSIDE_S * len(settings.users)
        return RateChoice(best_network_hz(settings, frame_s), "measured", frame_s, cost.frames)

    return found


def test_a_slower_machine_gets_a_lower_rate() -> None:
    settings, rates = room("cube"), []
    for hz in RATES_HZ[::-1]:
        borne_us = 1e6 * (SERVER_SHARE / hz - 2.0 * OUTSIDE_S)
        rates.append(choose(borne_us - 1.0)(settings).network_hz)
        assert choose(borne_us + 1.0)(settings).network_hz == max(RATES_HZ[0], hz // 2)
    assert rates == list(RATES_HZ[::-1])


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Settings whose rate is chosen at the start."""
    file = tmp_path / "room.toml"
    file.write_text('name = "box"\n[rates]\nnetwork_hz = "auto"\n[[users]]\nname = "anna"\n')
    return file


def test_what_is_chosen_at_the_start_is_in_the_settings_and_said_in_a_line(file: Path) -> None:
    slow, fast = RateChoices(choose(2500.0)), RateChoices(choose(50.0))
    assert load(file, rate=slow).rates.network_hz == 128
    assert load(file, rate=fast).rates.network_hz == 1024
    (line,) = slow.lines()
    assert line == (
        f"room box: rates.network_hz = 128: a frame takes the server 2600 µs (measured in {slow.found['box'].frames} frames), "
        "of 0.4 s a second that a room may take"
    )
    given = RateChoices(choose(50.0))
    assert load(file, ["rates.network_hz=256"], rate=given).rates.network_hz == 256, "a number is left alone"
    assert given.found == {}
    lab = RateChoices(stated)
    assert load(file, rate=lab).rates == load(file).rates
    assert lab.found["box"] == RateChoice(1024, "stated", PERSON_S)
    assert tomllib.loads(file.read_text())["rates"]["network_hz"] == "auto"


@pytest.mark.parametrize("encrypted", [False, True])
def test_a_server_that_was_killed_goes_on_at_its_rate(file: Path, tmp_path: Path, encrypted: bool) -> None:
    """However long a frame takes now: its checkpoint, and the seats that wait for their people, are of that rate."""
    before = load(file, rate=RateChoices(choose(1000.0)))
    assert before.rates.network_hz == 256
    folder = make_folder(tmp_path / "state")
    killed = Room(for_remote_clients(before) if encrypted else before)
    writer = CheckpointWriter(folder.checkpoint("box"))
    writer.put(encode(killed.checkpoint()))
    writer.close()
    again = RateChoices(choose(50.0), folder.path)
    settings = load(file, rate=again)
    assert settings.rates.network_hz == 256
    assert again.found["box"].by == "kept"
    Room(for_remote_clients(settings) if encrypted else settings).restore(killed.checkpoint(), 0)
    other = RateChoices(choose(50.0), folder.path)
    assert load(file, ["object.mass_kg=0.7"], rate=other).rates.network_hz == 1024, "of other settings: none that fits"
