"""`cogrip relay`: refusals, flags and files that reach the link, and output."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from cogrip.protocol.secure.channel import place_text

from tests.cli.command import Cogrip
from tests.extent import long
from tests.free_ports import free_port

PLACES = "--to 127.0.0.1:9 --listen 127.0.0.1:0"
TO = f"{PLACES} --seconds 0.001"
LIMIT_S = 60.0  # for anything that is waited for
TRACE = "t_s,delay_ms\n0,5\n1,lost\n"


pytestmark = pytest.mark.usefixtures("empty_folder")


REFUSED = {
    "--to nowhere.invalid": "--to nowhere.invalid:47800: ",
    "--to a:b:c": "--to 'a:b:c': an IPv6 address stands in brackets",
    "--to 127.0.0.1 --listen 127.0.0.1:99999": "--listen '127.0.0.1:99999': the port must be a number",
    "--to 127.0.0.1 --listen 192.0.2.1:0": "--listen 192.0.2.1:0 is no address of this machine",
    "--to [::1]:7 --listen [::1]:0 --flows 0": "--flows 0 is outside 1 to 400",
    f"{TO} --flows 401": "--flows 401 is outside 1 to 400",
    f"{TO} --idle-s 0.5": "--idle-s 0.5 is outside 1 to 1000000",
    f"{PLACES} --seconds 0": "--seconds 0 is no time to relay",
    f"{TO} --set coupling.kind=wave": "--set coupling.kind=wave: the relay takes keys of [link] only",
    f"{TO} --set link.los=0.1": "link.los: there is no such setting; did you mean link.loss?",
    f"{TO} --set link.outage_s=1": "link.up.outage_s = 1: link.up.outage_every_s",
    f"{TO} --up-trace none.csv": "--up-trace none.csv: cannot be read: No such file or directory",
    f"{TO} --down-trace none.csv": "--down-trace none.csv: cannot be read: No such file or directory",
    f"{TO} --outages none.csv": "--outages none.csv: cannot be read: No such file or directory",
    f"{TO} --profile wlan": 'expects "lan", "wifi", "wan", "lte" or "satellite"',
    f"file.toml {TO} --profile lan": "--profile and a settings file exclude each other",
    f"none.toml {TO}": "none.toml: there is no such file",
}
SCRIPTS = {
    "start,length\n": "1: the first line is 'start,length'; it must be start_s,length_s or start_s,length_s,way",
    "start_s,length_s\n1,0\n": "2: an outage of 0 s at 1 s: it must be longer than 0 and begin at 0 or later",
    "start_s,length_s\n-1,1\n": "2: an outage of 1 s at -1 s",
    "start_s,length_s\n1e300,1\n": "2: an outage of 1 s at 1e+300 s: it must be longer than 0",
    "start_s,length_s\n1,x\n": "2: 1,x: start_s and length_s must be numbers",
    "start_s,length_s\n1\n": "2: 1 columns",
    "start_s,length_s,way\n1,1,left\n": "2: way = 'left': write up, down, or nothing for both",
}


@pytest.mark.parametrize("arguments", REFUSED)
def test_a_wrong_flag_is_answered_with_its_cure(cogrip: Cogrip, arguments: str) -> None:
    cogrip.refuses(REFUSED[arguments], f"relay {arguments}")


@pytest.mark.parametrize("text", SCRIPTS)
def test_a_wrong_script_is_refused_with_its_line(cogrip: Cogrip, text: str) -> None:
    Path("o.csv").write_text(text)
    assert f"o.csv:{SCRIPTS[text]}" in cogrip.err(f"relay {TO} --outages o.csv")


def test_a_port_in_use_and_itself_are_refused(cogrip: Cogrip) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as used:
        used.bind(("127.0.0.1", 0))
        port = used.getsockname()[1]
        words = f"cannot listen on 127.0.0.1:{port}: Address already in use; choose another port"
        assert words in cogrip.err(f"relay --to 127.0.0.1:9 --listen 127.0.0.1:{port}", code=1)
    places = [("127.0.0.1", "127.0.0.1"), ("127.0.0.1", "0.0.0.0"), ("0.0.0.0", "127.0.0.1"), ("0.0.0.0", "0.0.0.0")]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
        probe.connect(("192.0.2.1", 9))  # by which address this machine reaches others, if it does; nothing is sent
        places.append(("0.0.0.0", probe.getsockname()[0]))
    for listen, to in places:
        words = f"--to {to}:{port} is where the relay itself listens"
        assert words in cogrip.err(f"relay --to {to}:{port} --listen {listen}:{port}")


@pytest.mark.long
@pytest.mark.parametrize(
    ("listen", "to"), [("0.0.0.0", "192.0.2.1"), long("127.0.0.2", "0.0.0.0"), long("0.0.0.0", "[::1]")]
)
def test_the_same_port_elsewhere_is_another_place(cogrip: Cogrip, listen: str, to: str) -> None:
    port = free_port()
    out = cogrip.out(f"relay --to {to}:{port} --listen {listen}:{port} --seconds 0.001")
    assert f"relaying from {listen}:{port} to {to}:{port}" in out


def test_it_says_what_it_does_and_that_it_does_nothing(cogrip: Cogrip) -> None:
    nothing = "up: adds nothing\ndown: adds nothing\nno network is emulated: give --profile NAME"
    assert nothing in cogrip.out(f"relay {TO}")
    out = cogrip.out(f"relay {TO} --profile wifi --set link.down.loss=0")
    assert "down: 2 ms, jitter 8 ms, outage of 0.1 s every 120 s\n" in out
    assert "no network" not in out


@pytest.mark.sample(1)
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a disk that is full, as Linux has one")
@pytest.mark.parametrize("full", [False, True])
def test_it_goes_on_when_nobody_reads_what_it_says(full: bool) -> None:
    reading, writing = os.pipe()
    os.close(reading)  # a reader who is gone
    out = os.open("/dev/full", os.O_WRONLY) if full else writing
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far:
        far.bind(("127.0.0.1", 0))
        place = ("127.0.0.1", free_port())
        process = subprocess.Popen(
            [sys.executable, "-m", "cogrip.cli.main", "relay", "--to", place_text(far.getsockname()), "--listen",
             place_text(place), "--json", "answer.json"],
            stdout=out, stderr=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip
        os.close(writing)
        if full:
            os.close(out)
        try:
            for number in (b"1", b"2"):  # two flows, a line each
                _hand_over(number, place, far)
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=LIMIT_S)
        finally:
            process.kill()
    assert (process.returncode, said) == (0, b"")
    answer = json.loads(Path("answer.json").read_text())
    assert answer["trouble"]["log line"] == 6, "nothing is emulated: three lines, where it listens, two flows"
    assert answer["flows_begun"] == 2


def _hand_over(payload: bytes, place: tuple[str, int], far: socket.socket) -> None:
    """Send one datagram to the relay, again until it listens; it must come out at the far end."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        far.settimeout(0.2)
        for _ in range(round(LIMIT_S / 0.2)):
            client.sendto(payload, place)
            with contextlib.suppress(TimeoutError):
                while far.recv(10) != payload:
                    pass
                return
    raise AssertionError("nothing came through")


def test_flags_and_files_reach_the_link(cogrip: Cogrip) -> None:
    Path("t.csv").write_text(TRACE)
    Path("o.csv").write_text("\ufeffstart_s,length_s,way\n1,2,up\n\n3,1,\n5,1,down\n6,1,up\n")
    flags = "--profile lte --set link.down.loss=0.25 --seed 9 --up-trace t.csv --outages o.csv --json answer.json"
    out = cogrip.out(f"relay {TO} {flags}")
    answer = json.loads(Path("answer.json").read_text())
    assert (answer["profile"], answer["seed"], answer["stopped"]) == ("lte", 9, "the time is over")
    assert (answer["link"]["up"]["delay_ms"], answer["link"]["down"]["delay_ms"]) == (25.0, 15.0)
    assert (answer["link"]["up"]["loss"], answer["link"]["down"]["loss"]) == (0.001, 0.25)
    assert (answer["link"]["up"]["trace"], answer["link"]["down"]["trace"]) == (str(Path("t.csv").absolute()), "")
    assert "up: 25 ms, jitter 6 ms, loss 0.1 % in runs of 5, 3 outages by script, trace /" in out
    assert "down: 15 ms, jitter 3 ms, loss 25 % in runs of 5, 2 outages by script" in out
    assert "relaying from 127.0.0.1:" in out


def test_a_settings_files_link_and_seed_are_taken_and_its_trace_lies_beside_it(cogrip: Cogrip) -> None:
    Path("deep").mkdir()
    Path("deep/t.csv").write_text(TRACE)
    Path("deep/storm.toml").write_text(
        'seed = 5\n[link]\ndelay_ms = 3.0\noutages = [[1, 2]]\n[link.down]\ntrace = "t.csv"\n'
    )
    out = cogrip.out(f"relay deep/storm.toml {TO} --json answer.json")
    answer = json.loads(Path("answer.json").read_text())
    assert (answer["seed"], answer["link"]["down"]["trace"]) == (5, str(Path("deep/t.csv").absolute()))
    assert "up: 3 ms, 1 outage by script" in out


@pytest.mark.parametrize("key", ["outages = [[1, 2]]", 'trace = "t.csv"'])
def test_a_server_refuses_what_no_welcome_carries(cogrip: Cogrip, key: str) -> None:
    Path("t.csv").write_text(TRACE)
    Path("storm.toml").write_text(f"[link]\n{key}\n")
    words = f"storm.toml: link.{key.partition(' ')[0]}: no welcome carries it, so that no client would emulate it"
    cogrip.refuses(words, "serve", "storm.toml", "--port", "0")


@pytest.mark.long
def test_at_a_terminal_the_status_goes_where_the_lines_go() -> None:
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "cogrip.cli.main", "relay", *PLACES.split(), "--seconds", "30", "--json", "-"],
        stdout=subprocess.PIPE, stderr=theirs, start_new_session=True,
    )  # fmt: skip
    os.close(theirs)
    said = b""
    try:
        while b"0 flows: up 0 in" not in said:
            said += os.read(ours, 4096)  # an error once the process has ended
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()
        os.close(ours)
    assert json.loads(out)["stopped"]
