"""Recordings of real sessions, killed at random moments: what was flushed is there, and plays again exactly."""

import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import pytest

from cogrip.protocol.recording.reader import Follower, RecordingError, open_recording
from cogrip.protocol.recording.records import kind_of
from cogrip.results.reading.folder import SERVER_RECORDING, client_recording
from cogrip.results.replay.verify import verify

from tests import forked
from tests.extent import every
from tests.live.held_arms import LIMIT_S, until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="finds the writers in /proc")

MOST_LOST_NS = 300_000_000  # of what was before a kill
DEMO = Path(__file__).resolve().parents[2] / "configs" / "demo.toml"
NAMES = ("anna", "ben", "cleo", "dora")
KILLS = """
name = "kills"
object.axes = 3
link = { delay_ms = 10.0, jitter_ms = 4.0, loss = 0.02 }
playout.frames = 2
"""


@dataclass
class End:
    """A process and the recording that it leaves."""

    name: str
    process: Any
    path: Path
    server: Any
    writer: int = field(init=False)
    _follower: Follower = field(init=False)
    _excused_ns: int = 0  # what the machine itself held up of what was to be on the disk

    def await_recording(self) -> None:
        """Until its file can be opened and its writer is known."""

        def opened() -> bool:
            with suppress(FileNotFoundError, RecordingError):  # not there, or not whole yet
                self._follower = Follower(self.path)
            return hasattr(self, "_follower")

        self.until(opened, "its file can be opened")
        self.writer = forked.child_of(self.process.popen.pid, "recording_process")

    def newest(self) -> int:
        """Number of the newest tick or step in the file."""
        found = {kind_of(topic): message for topic, message in self._follower.look().items()}
        return max((json.loads(found[kind].payload)[kind] for kind in ("tick", "step") if kind in found), default=0)

    def turns(self) -> int:
        """Return how often its loop has slept so far: once a tick."""
        status = Path(f"/proc/{self.process.popen.pid}/status").read_text()
        return int(status.partition("\nvoluntary_ctxt_switches:")[2].split()[0])

    def starved_ns(self) -> int:
        """Return how long its loop and its writer have waited for a processor so far, as far as the system says."""
        found = 0
        for pid in (self.process.popen.pid, self.writer):
            with suppress(OSError, IndexError):
                found += int(Path(f"/proc/{pid}/schedstat").read_text().split()[1])
        return found

    def until(self, good: Callable[[], bool], what: str, every_s: float = 0.02) -> None:
        """Wait for something. Skips the test where the machine stalled, fails it where the session broke off otherwise."""

        def seen() -> bool:
            if self.process.popen.poll() is not None:
                code = self.process.end()
                pytest.fail(
                    f"{self.name} has ended before it was told to, with {code}: {self.process.said}\n{self.server.said}"
                )
            return good()

        until(seen, f"{self.name}: {what}", every_s)

    def await_moment(self, chance: Random, rate_hz: int) -> None:
        """Until some of it is on the disk, and then to anywhere between two flushes."""
        begin_ns = self.starved_ns()
        written = self.newest() + chance.randrange(rate_hz // 2)
        self.until(lambda: self.newest() >= written, f"{written} on the disk")
        turned = self.turns() + chance.randrange(rate_hz // 4)
        self.until(lambda: self.turns() >= turned, f"{turned} turns", every_s=0.002)
        self._excused_ns = self.starved_ns() - begin_ns

    def await_end(self) -> None:
        """Until it is gone, and its writer, which has the same output."""
        self.process.popen.wait(LIMIT_S)
        self.process.read_to_the_end()

    def check(self, killed_ns: int | None = None) -> None:
        """The file opens, plays again exactly, and lacks nothing from before the kill but the last moment."""
        recording = open_recording(self.path)
        last_ns = 0
        for message in recording.messages():
            if kind_of(recording.topics[message.topic]) in ("tick", "step"):
                last_ns = message.time_ns
        verdict = verify(recording)
        assert verdict.exact, f"{self.name}: {verdict}"
        assert verdict.ticks > 0
        if killed_ns is None:
            assert recording.complete, self.name
            assert not recording.damage, self.name
            assert not verdict.cut, self.name
        else:
            assert verdict.cut, self.name
            print(
                f"{self.name}: {(killed_ns - last_ns) * 1e-6:.0f} ms before its kill ({self._excused_ns * 1e-6:.0f} ms of"
                f" them excused), {verdict.ticks} ticks play again"
            )
            assert killed_ns - last_ns <= MOST_LOST_NS + self._excused_ns, self.name
            assert all(damage.to_ns is None for damage in recording.damage), "nothing but the end is cut off"


@pytest.mark.long
@pytest.mark.parametrize("seed", every(5, (2, 0, 1, 3, 4)))
def test_whatever_is_killed_its_recording_and_those_of_the_others_play_again_exactly(run, serve, tmp_path, seed):
    """A server and four people; four of the five, or their writers, are killed one after the other."""
    chance = Random(seed)
    settings = tmp_path / "kills.toml"
    people = "".join(f'[[users]]\nname = "{name}"\nhand = "reach&direction=1,0.5,0.2"\n' for name in NAMES)
    settings.write_text(f"seed = {seed}\n{KILLS}{people}")
    folder = tmp_path / "run"
    folder.mkdir()
    server, port = serve(settings, "--into", str(folder))
    join = ("join", f"127.0.0.1:{port}", "--config", settings, "--into", folder)
    ends = [End("server", server, folder / SERVER_RECORDING, server)]
    ends += [End(name, run(*join, "--name", name), folder / client_recording(name), server) for name in NAMES]
    for end in ends:
        end.await_recording()
    for end in ends[1:]:
        end.process.hear("holds cube")

    plan = [(end, chance.choice(("process", "writer"))) for end in chance.sample(ends, 4)]
    plan.sort(
        key=lambda kill: kill[0].process is server and kill[1] == "process"
    )  # nobody outlives the server for long
    print("to be killed:", ", ".join(f"{end.name} ({part})" for end, part in plan))
    killed_ns = {}
    for end, part in plan:
        end.await_moment(chance, 128 if end.process is server else 1024)
        killed_ns[end.name] = time.monotonic_ns()
        os.kill(end.writer if part == "writer" else end.process.popen.pid, signal.SIGKILL)
    for end, part in plan:
        if part == "writer":
            end.process.hear(f"recording of {end.path.name} has stopped: its writer was ended from outside")
    for end in ends[1:]:
        end.process.signal(signal.SIGINT)
    for end in ends[1:]:
        end.await_end()
    server.signal(signal.SIGTERM)
    ends[0].await_end()

    for end in ends:
        end.check(killed_ns.get(end.name))
    assert len(killed_ns) == 4
    server_killed = (ends[0], "process") in plan
    for end in ends:
        if (end, "process") not in plan and not server_killed:
            lacks = end.process is not server and (end, "writer") in plan
            assert end.process.end() == lacks, f"a recording that stops is no reason to stop: {end.process.said}"


@pytest.mark.parametrize(("flag", "folder"), [("--runs", "/proc/cogrip"), ("--into", "/sys/cogrip")])
def test_where_nothing_can_be_written_a_session_goes_on_and_says_so(run, flag, folder):
    if not Path(folder).parent.is_mount():
        pytest.skip(f"{Path(folder).parent} is not mounted here: a plain folder could be written to")
    server = run("serve", DEMO, "--port", "0", "--seconds", "600", flag, folder)
    port = server.hear(r"listening on \S+:(\d+)")[1]
    person = run("join", f"127.0.0.1:{port}", "--seconds", "0.5", flag, folder)
    assert person.end() == 1, "it leaves nothing of what was asked for"
    assert "the session broke off" not in person.said
    server.signal(signal.SIGINT)
    assert server.end() == 0, server.said
    for process in (server, person):
        assert "this session is not recorded" in process.said
        assert folder in process.said
        assert "Traceback" not in process.said


def test_a_run_folder_removed_while_people_play_is_there_again_afterwards(run, serve, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    server, port = serve(DEMO, "--into", str(folder))
    person = run("join", f"127.0.0.1:{port}", "--into", folder)
    ends = [
        End("server", server, folder / SERVER_RECORDING, server),
        End("anna", person, folder / client_recording("anna"), server),
    ]
    for end in ends:
        end.await_recording()
        end.until(lambda end=end: end.newest() >= 50, "50 on the disk")
    shutil.rmtree(folder.rename(tmp_path / "removed"))  # at once: both ends go on making files in it
    for end in ends:
        end.until(end.path.exists, "its file is there again")
    for process in (person, server):
        process.signal(signal.SIGINT)
        assert process.end() == 0, process.said
        assert "recording" not in process.said
    for end in ends:
        end.check()
    assert len(list(folder.iterdir())) >= 3, "and the account of the person"
