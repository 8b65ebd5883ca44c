"""The unit of systemd: as systemd reads it, as the command line reads its arguments, as real time needs it."""

import configparser
import inspect
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cogrip.cli.serving.serve import serve
from cogrip.machine.realtime import PRIORITY

UNIT = Path(__file__).resolve().parents[1] / "configs" / "cogrip.service"
INSTALLED = "/opt/cogrip/bin/cogrip"
MOST_EXPOSURE = 20  # tenths, of 100; from 20 on systemd says "medium" where it says "ok" now

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed: the unit is read by no systemd"
)


def settings() -> configparser.SectionProxy:
    """[Service], a key's lines joined; a key that stands twice has its last value."""
    parser = configparser.ConfigParser(strict=False, interpolation=None, delimiters=("=",), comment_prefixes=("#",))
    parser.optionxform = str  # type: ignore[method-assign,assignment]
    parser.read_string(UNIT.read_text().replace("\\\n", " "))
    return parser["Service"]


@pytest.fixture
def unit(tmp_path) -> Path:
    """The unit with a program in it that is here."""
    text = UNIT.read_text()
    assert text.count(f"ExecStart={INSTALLED} ") == 1
    path = tmp_path / UNIT.name
    path.write_text(text.replace(f"ExecStart={INSTALLED} ", f"ExecStart={Path(sys.executable).resolve()} "))
    return path


def analyzed(*arguments: object) -> str:
    """Return the output of systemd-analyze, which must have found nothing wrong."""
    done = subprocess.run(["systemd-analyze", "--no-pager", *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@needs_systemd
def test_systemd_finds_nothing_wrong_but_what_is_and_little_exposed(unit):
    assert analyzed("verify", unit) == ""
    assert "OK" in analyzed("security", "--offline=true", f"--threshold={MOST_EXPOSURE}", unit)
    unit.write_text(unit.read_text().replace("WatchdogSec=5s", "WatchdogSec=soon"))
    done = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True)
    assert "soon" in done.stderr


def test_the_command_line_knows_every_argument():
    program, command, *arguments = shlex.split(settings()["ExecStart"])
    assert (program, command) == (INSTALLED, "serve")
    known = inspect.signature(serve).parameters
    flags = [argument.removeprefix("--") for argument in arguments if argument.startswith("--")]
    assert {"host", "port", "metrics", "log", "no-links"} <= set(flags)
    for flag in flags:
        assert flag.removeprefix("no-").replace("-", "_") in known, f"--{flag}"


def test_the_server_is_told_what_the_unit_promises():
    service = settings()
    assert service["Type"] == "notify"
    assert service["ExecReload"] == "/bin/kill -HUP $MAINPID"
    assert (service["Restart"], service["RestartSec"]) == ("always", "200ms")
    assert (service["StateDirectory"], service["StateDirectoryMode"]) == ("cogrip", "0700")
    assert service["WatchdogSec"]
    assert service["KillSignal"] == "SIGTERM"


def test_real_time_and_callbacks_of_openssl_are_allowed():
    """Callbacks are written to memory that is run: the cookie exchange fails where that is denied."""
    service = settings()
    assert int(service["LimitRTPRIO"]) >= PRIORITY
    assert (service["LimitMEMLOCK"], service["RestrictRealtime"]) == ("infinity", "no")
    for group in ("@resources", "@memlock"):  # sched_setscheduler, mlockall
        assert f"~{group}" not in UNIT.read_text()
    assert "MemoryDenyWriteExecute" not in service


@pytest.mark.parametrize("page", [UNIT, UNIT.parents[1] / "docs" / "operations.md"])
def test_what_is_installed_is_what_was_locked(page):
    """Every package by its hash, and nothing beside it: not even what builds ours."""
    installs = re.findall(r"/bin/pip (install .*)", page.read_text())
    assert [shlex.split(each, comments=True)[1:] for each in installs] == [
        ["--require-hashes", "-r", "requirements.lock"],
        ["--no-build-isolation", "--no-deps", "."],
    ]
    lock = (UNIT.parents[1] / "requirements.lock").read_text()
    assert re.search(r"^hatchling==", lock, re.MULTILINE)
