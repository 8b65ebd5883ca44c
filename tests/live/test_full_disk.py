"""A server whose disk is full: it plays on, comes back after `kill -9`, says what it cannot write, and mends by itself."""

import json
import signal
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from cogrip.protocol.recording.recover import is_closed

from tests.live.held_arms import DEMO, until
from tests.live.small_disk import SmallDisk, small_disk


@pytest.fixture
def disk() -> Iterator[SmallDisk]:
    with small_disk(24 * 1024, Path("/mnt")) as disk:
        yield disk


def health(port: int) -> dict:
    with suppress(OSError), urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz", timeout=10) as answer:
        return json.loads(answer.read())
    return {"status": "not there"}


def metrics(port: int) -> str:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
        return answer.read().decode()


def test_a_full_disk_ends_no_server_and_is_named_until_there_is_room(run, disk: SmallDisk, tmp_path: Path) -> None:
    state, port = disk.path / "state", "0"

    def serve(*more: str):
        server = run(
            "serve", DEMO, "--encrypted", "--port", port, "--state", state, "--runs", disk.path / "runs", "--no-report",
            "--metrics", "0", "--seconds", "600", "--free-gb", "0", *more,
        )  # fmt: skip
        found = server.hear(r"metrics: http://127.0.0.1:(\d+)/")
        return server, int(found[1]), server.hear(r"listening on \S+:(\d+)")[1]

    server, page, port = serve()
    link = server.hear(r"demo as player:  cogrip join '([^']+)'")[1]
    anna = run(
        "join", link, "--device", "sim:phantom?hand=reach", "--name", "anna", "--no-report", "--runs", tmp_path / "a"
    )
    server.hear("anna joined")
    until(lambda: health(page)["status"] == "ok", "all is well")
    until(lambda: (state / "checkpoint-demo.bin").exists(), "there is a checkpoint")
    disk.fill()
    until(lambda: "recording" in health(page).get("degraded", {}), "the recording's end is named")
    text = metrics(page)
    assert "cogrip_healthy 0.0" in text
    assert 'cogrip_degraded{what="recording"} 1.0' in text

    server.signal(signal.SIGKILL)
    server.popen.wait()
    disk.fill()  # what a recorder's process has let go
    server, page, _ = serve()
    server.hear("server.json: cannot be written: No space left on device")
    anna.hear("resumed after")
    until(lambda: "server.json" in health(page).get("degraded", {}), "what cannot be written is named")
    assert health(page)["status"].startswith("degraded: ")
    assert 'cogrip_degraded{what="server.json"} 1.0' in metrics(page)

    disk.make_room()
    until(
        lambda: not {"server.json", "checkpoints", "orders"} & set(health(page).get("degraded", {})),
        "it mends by itself",
    )
    assert json.loads((state / "server.json").read_text())["port"] == int(port)
    anna.signal(signal.SIGINT)
    anna.end()


def test_a_recording_ends_whole_before_the_disk_is_full(run, disk: SmallDisk, tmp_path: Path) -> None:
    """The floor is above what is free from the beginning; a session goes on without its recording, and ends in order."""
    server = run(
        "serve", DEMO, "--port", "0", "--state", tmp_path / "state", "--runs", disk.path / "runs", "--no-report",
        "--seconds", "600", "--free-gb", "1",
    )  # fmt: skip
    server.hear(r"recording of server.mcap has stopped: .* GB are free there, less than 1; make room")
    server.signal(signal.SIGINT)
    assert server.end() == 0, server.said
    (summary,) = (disk.path / "runs").glob("*/summary.json")
    assert json.loads(summary.read_text())["server"]["dropped"]["recording stopped"] == 1
    assert is_closed(summary.with_name("server.mcap"))


def test_a_client_whose_disk_fills_says_so_and_leaves_no_empty_files(run, serve, disk: SmallDisk) -> None:
    """Its hand is held to the end all the same."""
    _, port = serve(DEMO, "--no-record")
    runs = disk.path / "runs"
    anna = run("join", f"127.0.0.1:{port}", "--device", "sim:phantom?hand=reach", "--into", runs, "--no-report")
    until(lambda: any(path.stat().st_size > 20_000 for path in runs.glob("*.mcap")), "something is recorded")
    disk.fill()
    anna.hear("recording of client-anna.mcap has stopped: .*: No space left on device")
    anna.signal(signal.SIGINT)
    assert anna.end() == 1, anna.said
    assert "the recording that was asked for is not whole: recording stopped" in anna.said
    assert [path.name for path in runs.iterdir() if not path.stat().st_size or path.suffix == ".new"] == []
    assert list(runs.glob("*.json")) == []
