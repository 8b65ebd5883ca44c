"""Whole sessions as their users run them: processes, UDP on loopback, signals, kills."""

import json
import os
import re
import signal
import socket
from pathlib import Path

import msgpack
import msgspec
import pytest

from cogrip.protocol.recording.reader import Follower, RecordingError, open_recording
from cogrip.protocol.recording.records import Step
from cogrip.protocol.wire.messages import HELLO_BYTES, PROTOCOL_VERSION
from cogrip.results.reading.traces import load_run
from cogrip.results.replay.verify import ReplayVerdict, verify
from cogrip.server.checkpoint import decode
from cogrip.server.io import checkpoint_file
from cogrip.server.recorder import step_topic

from tests.extent import long
from tests.free_ports import free_port
from tests.live.held_arms import WITHOUT_PLOTS, Spoken, until
from tests.sim.session_measures import allowed

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
DEMO = CONFIGS / "demo.toml"
FEW_FRAMES, FEW_TICKS = 50, 200  # that any session of seconds has had, also where a busy machine had it skip most


def summary_in(folder: Path) -> dict:
    (path,) = folder.glob("*/summary.json")
    return json.loads(path.read_text())


IMPATIENT = "from cogrip.protocol.wire import session; session.RESUME_GIVE_UP_NS = 3 * 10**9\n"  # in place of 10 s
HOLD = ("--device", "sim:phantom?hand=hold")


def leaving(folder: Path) -> tuple[str, ...]:
    """Arguments for a run that leaves everything but a report there."""
    return "--runs", str(folder), "--no-report"


def steps_in(runs: Path) -> int:
    """Return the number of steps of room demo in the recording of the only run below `runs`, so far."""
    try:
        (path,) = runs.glob("*/server.mcap")
        newest = Follower(path).look().get(step_topic("demo"))
    except (ValueError, RecordingError):  # not there, or not whole yet
        return 0
    return msgspec.json.decode(newest.payload, type=Step).step if newest else 0


def replayed(runs: Path) -> dict[Path, ReplayVerdict]:
    """Return the verdict on each recording below `runs`."""
    return {path: verify(open_recording(path)) for path in runs.glob("**/*.mcap")}


def accounted(link: dict) -> bool:
    return all(
        link[direction]["sent"] == sum(link[direction][fate] for fate in ("applied", "late", "lost"))
        for direction in ("up", "down")
    )


def priority(process: Spoken) -> int:
    """Return a process's real-time priority, 0 for none."""
    return os.sched_getparam(process.popen.pid).sched_priority if hasattr(os, "sched_getparam") else 0


def test_two_people_hold_one_cube(run, serve, tmp_path):
    server, port = serve(DEMO)
    people = [
        run(
            "join", f"127.0.0.1:{port}", "--config", DEMO, "--name", name, "--seconds", "1.5", *leaving(tmp_path / name)
        )
        for name in ("anna", "ben")
    ]
    for person in people:
        person.hear("holds cube in room")
    priorities = [priority(process) for process in (server, *people)]
    assert [person.end() for person in people] == [0, 0], [person.said for person in people]
    assert priorities[0] < min(priorities[1:]) or not any(priorities), "0 where a system grants none"
    server.signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    whole = summary_in(tmp_path / "server")
    assert whole["passive"]
    assert not any(whole[key] for key in ("unstable", "saturated", "left"))
    assert whole["object"]["travel_m"] > 0.01
    assert [user["name"] for user in whole["users"]] == ["anna", "ben"]
    for user in whole["users"]:
        assert user["link"]["applied"] > FEW_FRAMES
        assert accounted(user["link"])
        assert user["ticks"]["due"] >= user["ticks"]["run"] > FEW_TICKS
        assert user["energy"]["up_margin_j"] + allowed("up_margin_j") >= -1e-12
        assert user["energy"]["down_margin_j"] + allowed("down_margin_j") >= -1e-12
    alone = summary_in(tmp_path / "anna")
    assert alone["users"][0]["proxy_m"] is not None, "the farewell carries the server's part"
    verdicts = replayed(tmp_path)
    assert {path.name for path in verdicts} == {"server.mcap", "client-anna.mcap", "client-ben.mcap"}
    for file, verdict in verdicts.items():
        assert verdict.exact, (file, verdict.difference, verdict.hole)
        assert not verdict.cut, file
        assert verdict.ticks > FEW_FRAMES, file


def test_a_client_holds_its_device_with_no_more_than_it_carries(run, serve, tmp_path):
    """Both ends say the same words; the server warns, the client gives the seat back before it opens the device."""
    outside = ["--set", "coupling.impedance_nspm=60", "--set", "users.0.device=sim:ideal"]
    server, port = serve(DEMO, *outside)
    text = server.hear(r"warning: room demo: (anna: b = 60 N s/m is more than .*)")[1]
    hold = [
        "join", f"127.0.0.1:{port}", "--name", "anna", "--device", "sim:ideal?hand=hold", "--seconds", "0.5",
        *leaving(tmp_path / "anna"),
    ]  # fmt: skip
    person = run(*hold)
    assert person.end() == 2, person.said
    assert f"refused: {text}; the settings are the server's; --allow-unstable" in person.said
    person = run(*hold, "--allow-unstable")
    assert person.end() == 0, person.said
    assert f"warning: {text}" in person.said
    (folder,) = [path.parent for path in (tmp_path / "anna").glob("*/summary.json")]
    assert f"anna: warning: {text}" in load_run(folder).notes, "as the report tells"
    server.signal(signal.SIGINT)
    server.end()
    (folder,) = [path.parent for path in (tmp_path / "server").glob("*/summary.json")]
    assert f"warning: room demo: {text}" in load_run(folder).notes


@pytest.mark.parametrize("number", [long(signal.SIGINT), signal.SIGTERM])
def test_a_signal_lets_go_and_leaves_a_report(run, serve, tmp_path, number):
    server, port = serve(DEMO)
    person = run("join", f"127.0.0.1:{port}", "--runs", tmp_path / "person", code=WITHOUT_PLOTS)
    person.hear("holds cube")
    person.signal(number)
    assert person.end() == 0, person.said
    server.hear("anna left")
    (folder,) = (tmp_path / "person").iterdir()
    assert (folder / "report.html").exists()
    assert summary_in(tmp_path / "person")["users"][0]["force_n"] == [0.0]


def test_the_server_stops_and_everyone_is_told(run, serve, tmp_path):
    server, port = serve(DEMO)
    person = run("join", f"127.0.0.1:{port}", *leaving(tmp_path / "person"))
    observer = run("join", f"127.0.0.1:{port}", "--observe")
    person.hear("holds cube")
    observer.hear("object at|nothing seen")
    server.signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    assert "\nstopped (SIGTERM)\n" in server.said
    assert person.end() == 1, "neither the person nor the time ended it"
    assert "the session is over, no force is left: the server was stopped (SIGTERM)\n" in person.said
    assert "broke off" not in person.said
    assert observer.end() == 1
    assert "observing is over: the server was stopped (SIGTERM)\n" in observer.said
    # the client's account still reached the server
    assert summary_in(tmp_path / "server")["users"][0]["ticks"]["run"] > 0


@pytest.mark.parametrize("stop", [("--stop-s", "0.75"), long(())])
def test_a_replay_that_has_run_out_ends_its_session(run, serve, tmp_path, stop):
    hand = tmp_path / "hand.csv"
    hand.write_text("t,x\n" + "".join(f"{tick / 100},{0.0001 * tick}\n" for tick in range(101)))
    _, port = serve(DEMO)
    person = run("join", f"127.0.0.1:{port}", "--device", f"replay:{hand}#time=t&x=x", *stop, *leaving(tmp_path / "a"))
    assert person.end() == 0, person.said
    assert "the session is over, no force is left: the replay has run out\n" in person.said
    (user,) = [user for user in summary_in(tmp_path / "a")["users"] if user["ticks"]["run"]]
    assert user["ticks"]["due"] >= (768 if stop else 1024)


def test_a_killed_server_leaves_no_force(run, serve, tmp_path):
    server, port = serve(DEMO)
    person = run("join", f"127.0.0.1:{port}", "--runs", tmp_path / "person", code=IMPATIENT + WITHOUT_PLOTS)
    person.hear("holds cube")
    server.signal(signal.SIGKILL)
    assert person.end() == 1
    assert "force released" in person.said
    assert "the session broke off, no force is left: no server for 3 s" in person.said
    assert summary_in(tmp_path / "person")["users"][0]["force_n"] == [0.0]
    (folder,) = (tmp_path / "person").iterdir()
    assert (folder / "report.html").exists()


def test_a_server_goes_on_after_a_kill_or_begins_fresh(run, tmp_path):
    """A real checkpoint, of an object that has moved."""
    state = tmp_path / "state"
    serve = (
        "serve",
        DEMO,
        "--port",
        "0",
        "--state",
        state,
        "--seconds",
        "600",
        "--no-record",
        *leaving(tmp_path / "server"),
    )
    server = run(*serve)
    port = server.hear(r"listening on \S+:(\d+)")[1]
    person = run("join", f"127.0.0.1:{port}", "--device", "sim:phantom?hand=reach", *leaving(tmp_path / "a"))

    def place_m():
        path = state / "checkpoint-demo.bin"
        kept = checkpoint_file.read(path)
        return abs(decode(kept).position_m[0]) if kept else 0.0

    until(lambda: place_m() > 0.005, "the object moves, and is kept")
    server.signal(signal.SIGKILL)
    server.end()
    kept_m = place_m()
    assert kept_m > 0.001
    restored = run(*serve)
    restored.hear(r"demo: restored: the object is at \((?!0\.0\))\S+\) mm, seats are kept for anna")
    restored.hear("listening on")
    restored.signal(signal.SIGKILL)  # the checkpoint stays
    restored.end()
    fresh = run(*serve, "--fresh")
    port = fresh.hear(r"listening on \S+:(\d+)")[1]
    assert "restored" not in fresh.said
    assert "demo: begins at its start (--fresh)" in fresh.said
    again = run("join", f"127.0.0.1:{port}", "--name", "anna", *HOLD, "--seconds", "0.2", *leaving(tmp_path / "b"))
    assert again.end() == 0, "nobody's seat is kept"
    fresh.signal(signal.SIGTERM)
    assert fresh.end() == 0, fresh.said
    summaries = [json.loads(path.read_text()) for path in (tmp_path / "server").glob("*/summary.json")]
    assert min(each["object"]["travel_m"] for each in summaries) < kept_m, "it counts from the start as well"
    person.signal(signal.SIGKILL)


def test_a_killed_client_loses_its_seat_and_the_other_goes_on(run, serve, tmp_path):
    server, port = serve(DEMO)
    lost = run("join", f"127.0.0.1:{port}", "--name", "anna", *HOLD, *leaving(tmp_path / "a"))
    stays = run("join", f"127.0.0.1:{port}", "--name", "ben", *HOLD, *leaving(tmp_path / "b"))
    lost.hear("holds cube")
    stays.hear("holds cube")
    lost.signal(signal.SIGKILL)
    server.hear("anna has been silent for too long")
    again = run("join", f"127.0.0.1:{port}", "--name", "anna", *leaving(tmp_path / "c"))
    again.hear("anna holds cube")
    stays.signal(signal.SIGINT)
    assert stays.end() == 0, stays.said
    user = summary_in(tmp_path / "b")["users"][0]
    assert user["peak_force_n"] < 0.5, "no kick"


def test_refusals_say_why_on_both_sides(run, serve, tmp_path):
    server, port = serve(CONFIGS / "paper.toml")  # one seat
    first = run("join", f"127.0.0.1:{port}", *leaving(tmp_path / "a"))
    first.hear("holds wall")
    second = run("join", f"127.0.0.1:{port}", "--runs", tmp_path / "b")
    assert second.end() == 1
    assert "the room is full" in second.said
    server.hear("the room is full")
    other = run("join", f"127.0.0.1:{port}", "--config", DEMO, "--room", "paper", "--runs", tmp_path / "b")
    assert other.end() == 1
    assert "full" in other.said or "settings" in other.said
    nowhere = run("join", f"127.0.0.1:{port}", "--room", "attic", "--runs", tmp_path / "b")
    assert nowhere.end() == 1
    assert "no room 'attic'" in nowhere.said
    assert not (tmp_path / "b").exists(), "nothing was run, nothing is left"


def test_unauthenticated_peers_are_refused_and_counted(serve, tmp_path):
    server, port = serve(DEMO)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.connect(("127.0.0.1", port))
        peer.settimeout(20)
        for garbage in (b"", b"hello", bytes(range(256)) * 6, msgpack.packb([4, 1, 2, 3])):
            peer.send(garbage)
        peer.send(msgpack.packb([1, "cogrip", 99, "9.9", 4711, "what", {"a": "newer"}, "protocol", bytes(HELLO_BYTES)]))
        tag, version, nonce, code, reason = msgpack.unpackb(peer.recv(2000))
    assert (tag, version, nonce, code) == (3, PROTOCOL_VERSION, 4711, "version")
    assert f"client speaks protocol 99, the server {PROTOCOL_VERSION}" in reason
    server.hear(f"client speaks protocol 99, the server {PROTOCOL_VERSION}")
    server.signal(signal.SIGTERM)
    server.end()
    dropped = summary_in(tmp_path / "server")["server"]["dropped"]
    assert dropped == {"empty": 1, "unauthenticated": 2, "too large": 1, "refused: version": 1}


def test_a_port_in_use_and_a_server_that_is_not_there(run, serve, tmp_path):
    _, port = serve(DEMO)
    second = run("serve", DEMO, "--port", str(port), "--runs", tmp_path)
    assert second.end() == 1
    assert f"cannot listen on 127.0.0.1:{port}" in second.said
    lonely = run("join", f"127.0.0.1:{free_port()}", "--runs", tmp_path / "x")
    assert lonely.end() == 1
    assert "no server answered" in lonely.said


@pytest.mark.long
def test_several_rooms_in_one_daemon(run, tmp_path):
    server = run(
        "serve", DEMO, CONFIGS / "three-users.toml", "--port", "0", "--seconds", "600", *leaving(tmp_path / "server")
    )
    port = server.hear(r"listening on \S+:(\d+)")[1]
    one = run("join", f"127.0.0.1:{port}", "--room", "demo", "--seconds", "1", *leaving(tmp_path / "1"))
    two = run("join", f"127.0.0.1:{port}", "--room", "three-users", "--seconds", "1", *leaving(tmp_path / "2"))
    assert one.end() == 0, one.said
    assert two.end() == 0, two.said
    server.signal(signal.SIGINT)
    assert server.end() == 0, server.said
    (folder,) = (tmp_path / "server").iterdir()
    assert {path.name for path in folder.iterdir()} == {"server.mcap", "demo", "three-users"}
    for name in ("demo", "three-users"):
        assert json.loads((folder / name / "summary.json").read_text())["name"] == name
        assert json.loads((folder / name / "settings.json").read_text())["name"] == name
    verdicts = replayed(tmp_path)
    assert len(verdicts) == 3, "a server's rooms are in one recording"
    for file, verdict in verdicts.items():
        assert verdict.exact, (file, verdict.difference, verdict.hole)
        assert not verdict.cut, file
        assert verdict.seconds < 600.0, "all of it on one clock"


def test_the_demo(run, tmp_path):
    demo = run("demo", "--seconds", "1", "--runs", tmp_path)
    assert demo.end() == 0, demo.said
    (folder,) = tmp_path.iterdir()
    assert summary_in(tmp_path)["passive"]
    assert (folder / "report.html").exists()
    assert len(list((folder / "plots").glob("*.png"))) >= 5


def child_of(demo, log):
    """The process id of the child of a demo whose output goes to a file of this name."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            ours = int((folder / "stat").read_text().rpartition(")")[2].split()[1]) == demo.popen.pid
            if ours and (folder / "fd" / "1").readlink().name == log:
                return int(folder.name)
        except (OSError, ValueError):  # it has ended meanwhile
            continue
    raise AssertionError(f"no child writes {log}")


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="children are found in /proc")
@pytest.mark.parametrize(
    ("log", "number", "code", "told"),
    [
        long("server.log", signal.SIGTERM, 1, r"\nanna: the server was stopped \(SIGTERM\) \(exit code 1\); see"),
        long("server.log", signal.SIGKILL, 1, r"\nserver: was killed by SIGKILL; see .*\nanna: no server for 10 s"),
        long("client-anna.log", signal.SIGTERM, 0, r"\nanna: ended early: stopped \(SIGTERM\)\n"),
        ("client-anna.log", signal.SIGKILL, 1, r"\nanna: was killed by SIGKILL; see .*client-anna.log\n"),
    ],
)  # fmt: skip
def test_the_demo_tells_how_a_process_ended(run, tmp_path, log, number, code, told):
    seconds = "30" if (log, number) == ("server.log", signal.SIGKILL) else "6"
    demo = run("demo", "--seconds", seconds, "--runs", tmp_path, code=WITHOUT_PLOTS)
    demo.hear("everyone holds on")
    until(lambda: steps_in(tmp_path) > 128, "a second of steps")  # so that the object has moved
    os.kill(child_of(demo, log), number)
    assert demo.end() == code, demo.said
    assert re.search(told, demo.said), demo.said
    assert "joined from" not in demo.said, "no line of a log in place of a reason"
    assert "trying to resume" not in demo.said
    assert "did not really move" not in demo.said
    assert "never sent anything" not in demo.said


def test_ctrl_c_in_the_demo_still_leaves_a_report(run, tmp_path):
    demo = run("demo", "--seconds", "60", "--runs", tmp_path, code=WITHOUT_PLOTS)
    demo.hear("everyone holds on")
    demo.signal(signal.SIGINT)
    assert demo.end() == 130, demo.said
    (folder,) = tmp_path.iterdir()
    assert (folder / "report.html").exists()
    for user in summary_in(tmp_path)["users"]:
        assert user["force_n"] == [0.0]


@pytest.mark.long
@pytest.mark.parametrize("number", [long(signal.SIGINT), signal.SIGTERM])
def test_a_signal_in_the_laboratory_keeps_what_was_run(run, tmp_path, number):
    lab = run("lab", DEMO, "--set", "seconds=100000", "--runs", tmp_path, code=WITHOUT_PLOTS)
    until(lambda: lab.popen.poll() is not None or steps_in(tmp_path) >= 10, "ten steps on the disk")
    lab.signal(number)
    assert lab.end() == 130, lab.said
    (folder,) = tmp_path.iterdir()
    assert (folder / "report.html").exists()
    assert 0 < summary_in(tmp_path)["seconds"] < 100_000
    for path in folder.glob("*.mcap"):
        recording = open_recording(path)
        assert sum(1 for _ in recording.messages()) > 10
        assert recording.complete


@pytest.mark.long
def test_simulated_hands_wait_until_every_seat_is_held(run, serve, tmp_path):
    lift = CONFIGS / "lift.toml"
    server, port = serve(lift)

    def joined(name):
        who = ("--config", lift, "--name", name, "--seconds", "0.5")
        return run("join", f"127.0.0.1:{port}", *who, *leaving(tmp_path / name))

    anna = joined("anna")
    anna.hear("the hand waits until everybody holds on")
    server.hear("lift: anna joined")
    assert "marker" not in server.said
    ben = joined("ben")
    for person in (anna, ben):
        person.hear("everybody holds on: the hand begins")
        assert person.end() == 0, person.said
    assert "lift: marker: everybody holds on" in server.said
