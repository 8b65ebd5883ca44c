"""Sessions around worlds of other authors: the examples of docs/worlds.md, one that fails, and one whose server is killed."""

from itertools import count
from pathlib import Path

import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.machine.stop import Stop
from cogrip.protocol.laws import felt_stiffness
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Farewell, Heartbeat
from cogrip.results.verdict.verdict import stable, succeeded
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import of_laboratory
from cogrip.server.admission.admission import AdmissionServices
from cogrip.server.checkpoint import CheckpointError, decode, encode
from cogrip.server.core import ServerCore
from cogrip.server.io.call_limit import call_limit
from cogrip.server.io.loop import LiveServer
from cogrip.server.ports.seat_limits import ClaimedRecord
from cogrip.server.rate_limit import RateLimiter
from cogrip.server.room import Room
from cogrip.server.unencrypted_channel import UnencryptedListener
from cogrip.server.worlds.conformance import CHECKS, Subject
from cogrip.server.worlds.guarded import GuardedWorld
from cogrip.server.worlds.registry import ALLOWED
from cogrip.sim.laboratory import Laboratory

from tests.extent import every, long
from tests.sim.session_measures import assert_plays_again, least_margin, run_frames

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples" / "worlds"
NAMES = sorted(path.stem for path in EXAMPLES.glob("*.py"))
FAILING = """
class Failing(TwoMasses):
    '''Raises after a while.'''
    frame = 0
    def move(self, force_n, damping_nspm):
        super().move(force_n, damping_nspm)
        self.frame += 1
        if self.frame == 40:
            raise RuntimeError("the spring broke")
"""
TABLE = """
name = "{name}"
seconds = 1.0
[object]
kind = "{kind}"
[[users]]
name = "anna"
hand = "reach&amplitude_m=0.02"
[[users]]
name = "ben"
hand = "hold"
"""


@pytest.fixture(autouse=True)
def allowed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(ALLOWED, f"{EXAMPLES}:{tmp_path}")


def world_in(room: Room) -> GuardedWorld:
    assert isinstance(room.world, GuardedWorld)
    return room.world


def failing(folder: Path) -> Settings:
    """Return the settings of a world that raises in its fortieth frame."""
    text = (EXAMPLES / "two_masses.py").read_text()
    (folder / "failing.py").write_text(text + FAILING)
    (folder / "failing.toml").write_text(TABLE.format(name="failing", kind="python:failing.py:Failing"))
    return load(folder / "failing.toml")


def test_there_are_four_examples() -> None:
    assert NAMES == ["soft_line", "steering_wheel", "two_masses", "viscous_field"]
    for path in EXAMPLES.glob("*.py"):
        assert len(path.read_text().splitlines()) <= 100


@pytest.mark.long
@pytest.mark.parametrize("name", every(3, NAMES))
def test_an_example_keeps_every_promise(name: str) -> None:
    settings = load(EXAMPLES / f"{name}.toml")
    for check in CHECKS:
        check(Subject(lambda: world_in(Room(settings)).inner))


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", every(2, NAMES))
def test_an_example_is_held_and_replayed(name: str, tmp_path: Path) -> None:
    summary = run_laboratory(load(EXAMPLES / f"{name}.toml", ["seconds=1.5"]), tmp_path).summary
    assert succeeded(summary)
    assert least_margin(summary) >= 0.0
    moved = summary["object"]["travel_m"] if name != "steering_wheel" else summary["users"][0]["peak_torque_nm"]
    assert moved > 0.005
    ledger = summary["server"]["energy_limiter"]
    assert ledger["limited_frames"] == 0
    assert ledger["level_j"] >= 0.0
    assert_plays_again(tmp_path)


@pytest.mark.long
@pytest.mark.parametrize(
    ("device", "delay_ms"), [("sim:phantom6", 10.0), long("sim:freeflyer", 0.0), long("sim:freeflyer", 40.0)]
)
def test_a_steering_wheel_feels_as_stiff_as_its_spring_and_the_line(
    device: str, delay_ms: float, tmp_path: Path
) -> None:
    """Held turned by 0.2 rad, 1/K_felt = 1/K + (T_fwd + T_back + T_n) / (2 b_r), theory section 4 with b_r for b."""
    hand = "waypoints&times_s=0.5,1.5&rz_rad=0,0.25"
    changes = (f"users.0.device={device}", f"users.0.hand={hand}", "users.1.hand=hold", f"link.delay_ms={delay_ms}")
    free = "users.1.device=sim:freeflyer?wrist_stiffness_nmprad=0&wrist_damping_nms=0&inertia_kgm2=1e-5"
    outcome = run_laboratory(load(EXAMPLES / "steering_wheel.toml", (*changes, free, "seconds=8")), tmp_path)
    assert succeeded(outcome.summary)
    assert least_margin(outcome.summary) >= 0.0
    anna = outcome.summary["users"][0]
    loop_s = 1e-3 * 2.0 * delay_ms
    predicted = felt_stiffness.felt_stiffness(0.1, felt_stiffness.line_compliance(0.02, loop_s, 1.0 / 128.0))
    assert anna["force_n"][5] / anna["position_m"][5] == pytest.approx(predicted, rel=0.02)
    assert_plays_again(tmp_path)


def test_a_world_that_raises_ends_its_session_by_name(tmp_path: Path) -> None:
    laboratory = Laboratory(failing(tmp_path))
    laboratory.run()
    words = "python:failing.py:Failing: RuntimeError: the spring broke (line "
    assert laboratory.incident.startswith(words)
    assert laboratory.room.steps == 40
    summary = of_laboratory(laboratory)
    assert stable(summary).sentence.startswith(f"Not stable: The world has ended: {words}")
    run_frames(laboratory, 64)
    for person in laboratory.people:
        assert words[:40] in person.core.session.failed
        assert person.core.act(laboratory.now_ns) == (0.0,)


def test_other_rooms_go_on_when_a_world_fails(tmp_path: Path) -> None:
    (tmp_path / "sound.toml").write_text(TABLE.format(name="sound", kind="cube"))
    sessions = count(1)
    core = ServerCore(
        [failing(tmp_path), load(tmp_path / "sound.toml")], "test", AdmissionServices(lambda: next(sessions))
    )
    for room in core.rooms:
        for seat in room.seats:
            room.take_seat(seat.number, next(sessions), 1, 0, ClaimedRecord("sim:ideal", 1, 1024.0, 40.0, 4.0))
            seat.address = f"{room.name} {seat.name}"
    world_in(core.rooms[0]).failed = "python:failing.py:Failing: broken"
    for room in 2 * core.rooms:
        core.tick(room, 0)
    heard = {str(address): messages.decode(datagram) for address, datagram in core.outbox}
    ended = heard["failing anna"]
    assert isinstance(ended, Farewell)
    assert ended.reason == "the world has ended: python:failing.py:Failing: broken"
    assert [seat.state for seat in core.rooms[0].seats] == ["free", "free"]
    assert [seat.state for seat in core.rooms[1].seats] == ["seated", "seated"]
    assert isinstance(heard["sound anna"], Heartbeat)
    assert any("failing: anna lost the seat: the world has ended" in event.text for event in core.events)


def test_a_live_server_bounds_the_time_of_a_step() -> None:
    settings = load(EXAMPLES / "two_masses.toml")
    server = LiveServer(
        [settings], "127.0.0.1", 0, Stop(), print, lambda core: UnencryptedListener(RateLimiter(b"s"), core.knows)
    )
    server.listen()
    server.close()
    assert world_in(server.core.rooms[0]).time_limit is call_limit


@pytest.mark.long
def test_after_a_kill_the_next_server_goes_on_where_the_world_was() -> None:
    laboratory = Laboratory(load(EXAMPLES / "soft_line.toml", ["seconds=3"]))
    run_frames(laboratory, 200)
    before = world_in(laboratory.room)
    (checkpoint,) = laboratory.kill()
    state = before.inner.save()
    laboratory.restart([decode(encode(checkpoint))])
    after = world_in(laboratory.room)
    assert after.inner.save()[-54:] == state[-54:]  # places and speeds of nine beads in three axes
    assert not after.holding.any()
    laboratory.run()
    assert not laboratory.incident
    assert after.holding.all(), "both came back"
    assert after.limiter.limited == 0


def test_a_checkpoint_of_a_changed_file_is_refused(tmp_path: Path) -> None:
    first = Room(failing(tmp_path))
    file = tmp_path / "failing.py"
    file.write_text(file.read_text().replace("300.0", "200.0"))
    second = Room(load(tmp_path / "failing.toml"))
    with pytest.raises(CheckpointError, match="its world is another one"):
        second.restore(first.checkpoint(), 0)


def test_the_folder_of_a_file_is_in_no_digest_and_no_welcome(tmp_path: Path) -> None:
    here = load(EXAMPLES / "two_masses.toml")
    (tmp_path / "two_masses.py").write_text((EXAMPLES / "two_masses.py").read_text())
    (tmp_path / "two_masses.toml").write_text((EXAMPLES / "two_masses.toml").read_text())
    there = load(tmp_path / "two_masses.toml")
    assert digest(here) == digest(there)
    assert Room(there).seats[0].settings.object.kind == "python:two_masses.py:TwoMasses"
    assert digest(load(EXAMPLES / "two_masses.toml", ["object.kind=cube"])) != digest(here)
