"""The example of the client in C beside a Python client: processes, UDP on loopback, DTLS by the system's library."""

import json
import re
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from cogrip.protocol.settings.coupling_kinds import lent_mj
from cogrip.results.verdict.verdict import passive

from tests.clients.compiled import CHECKED, build, has_libssl, needs_compiler
from tests.extent import long
from tests.free_ports import free_port
from tests.live.redirecting_front import redirecting
from tests.live.test_live_sessions import DEMO, FEW_FRAMES, summary_in
from tests.stalls import MACHINE_STALLED

pytestmark = [needs_compiler, pytest.mark.skipif(not has_libssl(), reason="no headers of libssl: install libssl-dev")]

SECONDS = "1.0"
ROUNDING_J = 1e-12
COUNTING = ("counting.c", "-Wl,--wrap=cogrip_tick")


def sealed(folder: Path) -> tuple[str, ...]:
    return "--encrypted", "--state", str(folder / "state")


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return what compiles the example: "checked" by the sanitizers, "counting" allocations in ticks."""
    built: dict[str, Path] = {}

    def program(kind: str) -> Path:
        if kind not in built:
            flags = CHECKED if kind == "checked" else ("-O1", *COUNTING)
            built[kind] = build(
                tmp_path_factory.mktemp(kind), "example", *flags, "example.c", "cogrip.c", "-lssl", "-lcrypto"
            )
        return built[kind]

    return program


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("encrypted", "kind"),
    [(True, "checked"), (False, "counting"), long(False, "checked"), long(True, "counting")],
)
def test_a_person_by_c_and_one_by_python_hold_one_cube(
    run, serve, tmp_path: Path, example, encrypted: bool, kind: str
) -> None:
    program = example(kind)
    server, port = serve(DEMO, "--set", "link.delay_ms=0", *(sealed(tmp_path) if encrypted else []))
    target = server.hear(r"(cogrip://[^' ]+)'")[1] if encrypted else f"127.0.0.1:{port}"
    ben = run("join", target, "--name", "ben", "--seconds", SECONDS, "--runs", str(tmp_path / "ben"), "--no-report")
    anna = subprocess.run(
        [program, "-", SECONDS, "anna"], input=target, capture_output=True, text=True, timeout=60, check=False
    )
    if "watchdog" in anna.stderr:
        pytest.skip(f"{MACHINE_STALLED} from a loop for 100 ms: no live session can be judged on it now")
    assert anna.returncode == 0, anna.stderr
    assert ben.end() == 0, ben.said
    server.signal(signal.SIGTERM)
    server.end()
    said, whole = json.loads(anna.stdout), summary_in(tmp_path / "server")
    assert said["frames"] > FEW_FRAMES
    assert min(said["up_margin_j"], said["down_margin_j"], said["line_margin_j"] / 2) >= -1e-3 - ROUNDING_J
    assert whole["passive"], server.said
    assert passive(whole).tone == "good", passive(whole)
    assert not any(whole[key] for key in ("unstable", "saturated", "left"))
    for user in whole["users"]:
        assert user["state"] == "idle"
        assert user["link"]["applied"] > FEW_FRAMES
        assert user["energy"]["up_margin_j"] >= -1e-3 - ROUNDING_J
        assert user["energy"]["device_margin_j"] >= 0.0
    assert [user["name"] for user in whole["users"]] == ["anna", "ben"]
    if kind == "counting":
        found = re.search(r"(\d+) ticks, (\d+) allocations in ticks, (\d+) outside", anna.stderr)
        assert found
        assert int(found[1]) > FEW_FRAMES
        assert int(found[3]) > 0  # what it counts at all
        assert int(found[2]) == 0


def test_a_person_by_c_and_one_by_python_hold_one_cube_with_models_of_each_other(
    run, serve, tmp_path: Path, example
) -> None:
    held = ("--set", "coupling.kind=partner", "--set", "link.delay_ms=0")
    server, port = serve(DEMO, *held)
    target = f"127.0.0.1:{port}"
    ben = run("join", target, "--name", "ben", "--seconds", "2.0", "--runs", str(tmp_path / "ben"), "--no-report")
    anna = subprocess.run(
        [example("checked"), target, "2.0", "anna"], capture_output=True, text=True, timeout=60, check=False
    )
    if "watchdog" in anna.stderr:
        pytest.skip(f"{MACHINE_STALLED} from a loop for 100 ms: no live session can be judged on it now")
    assert anna.returncode == 0, anna.stderr
    assert ben.end() == 0, ben.said
    server.signal(signal.SIGTERM)
    server.end()
    said, whole = json.loads(anna.stdout), summary_in(tmp_path / "server")
    assert said["frames"] > FEW_FRAMES
    assert said["down_margin_j"] >= -1e-3 * lent_mj("partner", 0.0)
    assert said["device_margin_j"] >= 0.0
    assert said["peak_force_n"] > 0.02  # how long both are there together is the machine's affair
    assert not {"malformed", "unfit"} & said.keys()
    for user in whole["users"]:
        assert user["state"] == "idle"
        assert user["link"]["applied"] > FEW_FRAMES
        assert user["energy"]["device_margin_j"] >= 0.0


@pytest.mark.parametrize("encrypted", [True, long(False)])
def test_both_clients_follow_a_redirect(run, serve, tmp_path: Path, example, encrypted: bool) -> None:
    """They ask a front, and hold the object of another server, whose key it has."""
    server, port = serve(DEMO, "--set", "link.delay_ms=0", *(sealed(tmp_path) if encrypted else []))
    state = tmp_path / "state" if encrypted else None
    with redirecting(DEMO, f"127.0.0.1:{port}", state) as front:
        target = f"127.0.0.1:{front}"
        if encrypted:
            target = server.hear(r"(cogrip://[^' ]+)'")[1].replace(f":{port}/", f":{front}/")
        ben = run("join", target, "--name", "ben", "--seconds", SECONDS, "--runs", str(tmp_path / "ben"), "--no-report")
        anna = subprocess.run(
            [example("checked"), "-", SECONDS, "anna"],
            input=target,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert anna.returncode == 0, anna.stderr
        assert ben.end() == 0, ben.said
    server.signal(signal.SIGTERM)
    server.end()
    assert [user["link"]["applied"] > FEW_FRAMES for user in summary_in(tmp_path / "server")["users"]] == [True, True]


@pytest.mark.long
@pytest.mark.parametrize("encrypted", [True, False])
@pytest.mark.parametrize("killed", [True, False])
def test_a_seat_is_resumed_by_a_new_path(run, tmp_path: Path, example, encrypted: bool, killed: bool) -> None:
    """The server stands still for a while; or it is killed, and another one goes on from its checkpoint."""
    port, state = (
        free_port(),
        ("--encrypted", "--state", tmp_path / "state") if encrypted else ("--state", tmp_path / "state"),
    )
    command = (
        "serve",
        DEMO,
        "--set",
        "link.delay_ms=0",
        "--port",
        str(port),
        "--seconds",
        "600",
        "--no-report",
        *state,
    )
    server = run(*command, "--runs", tmp_path / "first")
    server.hear(r"listening on")
    target = server.hear(r"(cogrip://[^' ]+)'")[1] if encrypted else f"127.0.0.1:{port}"
    with subprocess.Popen(
        [example("checked"), "-", "8", "anna"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as anna:
        assert anna.stdin
        assert anna.stdout
        assert anna.stderr
        anna.stdin.write(target + "\n")
        anna.stdin.close()
        lines = iter(anna.stderr)
        assert any("holds the object" in line for line in lines)
        server.hear("anna joined")
        server.signal(signal.SIGKILL if killed else signal.SIGSTOP)
        assert any("trying to resume" in line for line in lines)
        if killed:
            server.end()
            server = run(*command, "--runs", tmp_path / "second")
        else:
            server.signal(signal.SIGCONT)
        assert any(line == "example: resumed\n" for line in lines)
        said = json.loads(anna.stdout.read())
        rest = "".join(lines)
    assert anna.returncode == 0, rest
    assert said["resumed" if not killed else "line begun anew"] == 1
    assert min(said["up_margin_j"], said["down_margin_j"], said["line_margin_j"] / 2) >= -1e-3 - ROUNDING_J


def test_another_certificate_than_the_links_is_refused_and_nothing_sent(serve, tmp_path: Path, example) -> None:
    server, _ = serve(DEMO, *sealed(tmp_path))
    link = server.hear(r"(cogrip://[^' ]+)'")[1]
    place, _, secret = link.partition("#")
    wrong = f"{place}#{'0' * 64}{secret[64:]}"
    done = subprocess.run(
        [example("checked"), "-", "1"], input=wrong, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert "the server's certificate is not the one of the link" in done.stderr
    assert secret[65:] not in done.stderr
    server.signal(signal.SIGTERM)
    server.end()
    assert "joined" not in server.said


@pytest.mark.parametrize(("target", "why"), [
    ("cogrip://127.0.0.1/lab", "the part after # is missing"), ("192.0.2.1:47800", "unencrypted to another machine"),
        ("", "there is none"),
    ("[::1", "as [ADDRESS]:PORT"),
])  # fmt: skip
def test_a_target_that_cannot_be_is_refused_in_one_line(example, target: str, why: str) -> None:
    done = subprocess.run(
        [example("checked"), "-", "1"], input=target, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert why in done.stderr
    assert done.stderr.count("\n") == 1
