"""The container's file: what it starts, how it is looked after and how it is stopped, by the very words that stand there."""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.free_ports import free_port
from tests.live.held_arms import until

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "configs" / "Containerfile").read_text("utf-8").replace("\\\n", " ")

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a container of Linux")


def words(instruction: str) -> list[str]:
    """Return the words of an instruction in the form of a list."""
    found: list[str] = json.loads(re.search(rf"^{instruction}.*?(\[.*\])", TEXT, re.MULTILINE)[1])  # type: ignore[index]
    return found


def test_it_starts_says_that_it_is_well_keeps_the_seats_at_its_end_and_then_is_not_well(start, tmp_path):
    port, page = str(free_port()), str(free_port())
    here = {"/var/lib/cogrip": str(tmp_path), "47800": port, "9147": page}

    def placed(each: str) -> str:
        for there, mine in here.items():
            each = each.replace(there, mine)
        return each

    program, *flags = map(placed, words("ENTRYPOINT"))
    assert program == "/opt/cogrip/bin/cogrip"
    server = start(*flags, *map(placed, words("CMD")))
    server.hear("rooms on demand of template demo")
    python, *probe = map(placed, words("HEALTHCHECK"))
    assert python == "/opt/cogrip/bin/python"
    well = [sys.executable, *probe]
    until(lambda: subprocess.run(well, capture_output=True, check=False).returncode == 0, "the server is well")
    opened = start("room", "new", "demo", "--name", "group 7", "--state", tmp_path)
    assert opened.end() == 0
    assert re.search("^STOPSIGNAL SIGTERM$", TEXT, re.MULTILINE)
    server.popen.send_signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    assert subprocess.run(well, capture_output=True, check=False).returncode != 0
    again = start(*flags, *map(placed, words("CMD")))
    again.hear("rooms on demand of template demo")
    listed = start("room", "list", "--state", tmp_path)
    assert listed.end() == 0
    assert "group 7" in listed.said, "rooms that were open are open again"
    again.popen.send_signal(signal.SIGTERM)
    assert again.end() == 0


def test_what_is_installed_is_what_was_locked():
    installs = re.findall(r"/bin/pip (install [^&]*)", TEXT)
    assert [re.sub(r"--no-cache-dir |\s+$", "", each) for each in installs] == [
        "install --require-hashes -r requirements.lock",
        "install --no-build-isolation --no-deps .",
    ]


def test_no_registry_is_named():
    assert re.findall(r"^FROM (\S+)", TEXT, re.MULTILINE) == ["python:3.12-slim"] * 2
