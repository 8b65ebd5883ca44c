"""Rooms over several processes: one port, a kill of a worker, orders to all. Real processes, real sockets, real kills."""

import os
import re
import secrets
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from cogrip.protocol.wire.join_link import parse_link
from cogrip.results.replay.verify import verify
from cogrip.server.checkpoint import decode
from cogrip.server.io import checkpoint_file

from tests.free_ports import free_port
from tests.live.held_arms import DEMO, Spoken, fairly, until
from tests.live.test_unauthenticated_peers import MOST_STEP_N, PULL, Relay, before_silence, largest_step_n, recording_of
from tests.stalls import MACHINE_STALLED

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="several workers need Linux, which steers datagrams")


class Rooms:
    """A server of the rooms attic, cellar and hall over two workers: the second has the cellar alone."""

    def __init__(self, start: Callable[..., Spoken], base: Path, *arguments: str) -> None:
        self.state, self.port, self.runs = base / "state", free_port(), base / "server"
        self._start = start
        configs = []
        for name in ("attic", "cellar", "hall"):
            configs.append(base / f"{name}.toml")
            configs[-1].write_text(
                DEMO.read_text(encoding="utf-8").replace('name = "demo"', f'name = "{name}"'), "utf-8"
            )
        self.process = start(
            "serve", *configs, "--workers", "2", "--port", self.port, "--state", self.state, "--seconds", "600",
            "--no-report", "--set", "link.delay_ms=0", "--runs", self.runs, *arguments,
        )  # fmt: skip
        self.process.hear("listening on")

    def ask(self, *words: object, code: int = 0) -> str:
        """Return what an administrator's command says."""
        asked = self._start(*words, "--state", self.state)
        assert asked.end() == code, asked.said
        return asked.said

    def where(self, room: str) -> tuple[str, ...]:
        """Return the arguments of `cogrip join` for a room."""
        found = re.search(rf"join {room} as player: .*'(cogrip:\S+)'", self.process.said)
        return (found[1],) if found else (f"127.0.0.1:{self.port}", "--room", room)

    def worker(self, number: int) -> int:
        """Return the process id of a worker."""
        self.process.rewind()
        return int(self.process.hear(rf"worker {number} \(process (\d+)\) serves")[1])


@pytest.fixture
def join(start, tmp_path) -> Callable[..., Spoken]:
    def someone(where: tuple[str, ...], *arguments: str) -> Spoken:
        runs = tmp_path / secrets.token_hex(4)
        person = start("join", *where, "--no-report", "--runs", runs, *PULL, *arguments)
        person.runs = runs
        return person

    return someone


def leave(*people: Spoken) -> None:
    for person in people:
        person.popen.send_signal(signal.SIGINT)
    for person in people:
        assert person.end() == 0, person.said


@pytest.mark.sample(1)
@pytest.mark.parametrize("encryption", ["--insecure", "--encrypted"])
@fairly
def test_after_a_worker_is_killed_its_people_resume_and_nobody_else_notices(start, tmp_path, join, encryption):
    rooms = Rooms(start, tmp_path, encryption)
    anna = join(rooms.where("attic"), "--name", "anna")
    ben = join(rooms.where("cellar"), "--name", "ben")
    for person in (anna, ben):
        person.hear(r"(anna|ben) holds cube in room")
    kept = rooms.state / "checkpoint-cellar.bin"
    until(
        lambda: kept.exists() and any(seat.ticket for seat in decode(checkpoint_file.read(kept) or b"").seats),
        "ben's seat is kept",
    )
    os.kill(rooms.worker(2), signal.SIGKILL)
    rooms.process.hear(
        "cellar: restored: the object is at .* seats are kept for ben"
    )  # by another process than the next
    rooms.process.rewind()
    rooms.process.hear("worker 2 has ended; another one goes on with cellar")
    ben.hear(r"resumed after [\d.]+ s")
    rooms.process.hear("cellar: ben resumed from")
    ben.hear("force ramps in")
    os.kill(rooms.worker(3), signal.SIGKILL)
    rooms.process.hear("worker 3 has ended; another one goes on with cellar")
    ben.hear(r"resumed after ([\d.]+) s")
    ben.hear("force ramps in")
    assert "2 in 3 rooms" in rooms.ask("who")
    leave(anna, ben)
    rooms.process.popen.send_signal(signal.SIGTERM)
    assert rooms.process.end() == 0, rooms.process.said

    end = recording_of(ben)
    assert largest_step_n(end, before_silence(end)) < MOST_STEP_N
    assert verify(end.recording).exact
    for words in ("force released", "silent"):
        assert words not in anna.said
    assert "resumed" not in "".join(line for line in rooms.process.said.splitlines() if "attic" in line)
    recordings = sorted(path.parent.name for path in rooms.runs.glob("*/worker-*/server.mcap"))
    assert recordings == ["worker-1", "worker-2", "worker-3", "worker-4"]
    assert sorted(path.parent.name for path in rooms.runs.glob("*/*/summary.json")) == ["attic", "cellar"]


@fairly
def test_an_administrator_reaches_people_in_every_worker(start, tmp_path, join):
    rooms = Rooms(start, tmp_path, "--encrypted")
    assert "nobody is here" in rooms.ask("who")
    anna, ben = join(rooms.where("attic"), "--name", "anna"), join(rooms.where("cellar"), "--name", "ben")
    other = join(rooms.where("cellar"), "--name", "anna")
    for person in (anna, ben, other):
        person.hear("holds cube in room")
    said = rooms.ask("who")
    assert re.search(r"anna +attic.*\n.*cellar.*\n.*cellar", said), said
    assert "3 in 3 rooms" in said
    assert "1 in 1 room" in rooms.ask("who", "--room", "attic")
    assert "marked in 3 rooms: now" in rooms.ask("mark", "now")
    rooms.process.hear("attic: marker: now")
    assert "ben: " in rooms.ask("set", "ben", "position_scale=2")
    assert "seated in several rooms" in rooms.ask("set", "anna", "position_scale=2", code=1)
    assert "anna: " in rooms.ask("set", "anna", "position_scale=2", "--room", "cellar")
    assert "nobody here is 'zoe'" in rooms.ask("kick", "zoe", code=1)
    link = parse_link(rooms.where("cellar")[0])
    tokens = rooms.ask("token", "list")
    ident = re.search(r"([0-9a-f]{8}).*player.*cellar", tokens)
    assert ident, tokens
    assert link.token not in rooms.ask("kick", "ben", "--revoke")
    for person in (ben, other):
        person.hear("kicked")
        assert person.end() == 1, person.said
    assert anna.popen.poll() is None, "she came by another link"
    late = join(rooms.where("cellar"))
    assert late.end() == 1
    assert "[token]" in late.said
    leave(anna)


@fairly
def test_whoever_names_no_room_gets_a_free_seat_and_a_one_time_link_is_good_once(start, tmp_path, join):
    rooms = Rooms(start, tmp_path, "--encrypted", "--no-links")
    made = rooms.ask("token", "new", "--once", "--note", "any room")
    once = re.search(r"cogrip://\S+?(?=['\s]|$)", made)
    assert once, made
    found = {
        person: person.hear(r"holds cube in room|token was used already")[0]
        for person in (join((once[0],)), join((once[0],)))
    }
    assert sorted(found.values()) == ["holds cube in room", "token was used already"]
    leave(*(person for person, words in found.items() if words == "holds cube in room"))


@pytest.mark.long
@fairly
def test_another_port_of_a_person_leads_to_the_same_worker(start, tmp_path, join):
    rooms = Rooms(start, tmp_path, "--encrypted")
    relay = Relay(rooms.port)
    try:
        ben = join(
            (msgspec.structs.replace(parse_link(rooms.where("cellar")[0]), port=relay.port).text,), "--name", "ben"
        )
        ben.hear("ben holds cube in room")
        relay.rebind()
        ben.hear(r"resumed after ([\d.]+) s")
        rooms.process.hear("cellar: ben resumed from")
        ben.hear("force ramps in")
        assert "1 in 3 rooms" in rooms.ask("who")
        rooms.process.popen.send_signal(signal.SIGTERM)
        assert rooms.process.end() == 0, rooms.process.said
        assert "the server was stopped" in ben.said or ben.hear("the server was stopped")
    finally:
        relay.close()


@pytest.mark.long
@fairly
def test_the_rooms_of_a_front_that_is_killed_are_found_by_the_next_server(start, tmp_path, join):
    rooms = Rooms(start, tmp_path, "--encrypted")
    ben = join(rooms.where("cellar"), "--name", "ben")
    ben.hear("ben holds cube in room")
    rooms.process.popen.kill()
    rooms.process.read_to_the_end()  # the workers have its standard output, and end by themselves
    again = start(
        "serve", *(tmp_path / f"{name}.toml" for name in ("attic", "cellar", "hall")), "--workers", "2", "--encrypted",
        "--port", rooms.port, "--state", rooms.state, "--seconds", "600", "--no-report", "--set", "link.delay_ms=0",
        "--runs", rooms.runs,
    )  # fmt: skip
    again.hear("cellar: restored")
    if "no server for" in ben.said:
        pytest.skip(f"{MACHINE_STALLED}: a server did not start within the 10 s for which a client waits")
    ben.hear(r"resumed after ([\d.]+) s")
    again.hear("cellar: ben resumed from")
    leave(ben)


@fairly
def test_rooms_on_demand_are_spread_over_workers_and_outlast_a_kill(start, tmp_path, join):
    template = tmp_path / "lesson.toml"
    template.write_text(DEMO.read_text(encoding="utf-8").replace('name = "demo"', 'name = "lesson"'), "utf-8")
    rooms = Rooms(start, tmp_path, "--encrypted", "--template", f"{template}:3", "--empty-after", "600")
    rooms.process.hear("3 rooms on demand of template lesson")

    def opened(name: str) -> str:
        return re.search(r"cogrip:\S+", rooms.ask("room", "new", "lesson", "--name", name, "--label", "class=physics"))[
            0
        ]

    links = {name: opened(name) for name in ("one", "two", "three")}
    for words, why in (
        (("room", "new", "lesson"), "all rooms of template 'lesson' are open; close one"),
        (("room", "new", "lesson", "--name", "one"), "there is a room 'one' already"),
        (("room", "new", "lesson", "--name", "hall"), "there is a room 'hall' already"),
        (("room", "close", "attic"), "no room 'attic' was opened on demand; there is: one, two, three"),
    ):
        assert why in rooms.ask(*words, code=1)
    anna, ben = (join((links[room],), "--name", name) for room, name in (("one", "anna"), ("two", "ben")))
    for person in (anna, ben):
        person.hear("holds cube in room")
    listed = rooms.ask("room", "list", "--label", "class=physics")
    assert re.search(r"one +lesson +1 of 2", listed)
    assert re.search(r"three +lesson +0 of 2", listed)
    assert "one: object.mass_kg=0.3" in rooms.ask("set", "object.mass_kg=0.3", "--room", "one")
    rooms.process.rewind()
    before = [int(rooms.process.hear(rf"worker {number} \(process (\d+)\) serves")[1]) for number in (1, 2)]
    until(
        lambda: sum(
            bool(seat.ticket)
            for kept in rooms.state.glob("checkpoint-lesson*.bin")
            for seat in decode(checkpoint_file.read(kept) or b"").seats
        ) == 2,
        "both seats are kept",
    )  # fmt: skip
    for process in before:
        os.kill(process, signal.SIGKILL)
    for person in (anna, ben):
        person.hear(r"resumed after [\d.]+ s")
        person.hear("force ramps in")
    assert re.search(r"one +lesson +1 of 2", rooms.ask("room", "list"))
    assert "closed; sessions ended: 1" in rooms.ask("room", "close", "two")
    assert ben.end() == 1, "whoever is in a room that is closed is sent out"
    late = join((links["two"],), "--name", "ben")
    assert late.end() == 1
    assert "this token was revoked" in late.said
    assert "cogrip:" in rooms.ask("room", "new", "lesson", "--name", "four"), "its place is free again"
    leave(anna)
    rooms.process.popen.send_signal(signal.SIGTERM)
    assert rooms.process.end() == 0, rooms.process.said
