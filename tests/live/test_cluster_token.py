"""A Ray cluster that asks for its token: rooms work in it, and beyond loopback no other one will do."""

import os
import re
import secrets
import signal
import sys
from collections.abc import Iterator

import pytest

from cogrip.server.hosting.cluster.ray_token import asks_for_token

from tests.free_ports import free_port
from tests.live.held_arms import DEMO, fairly
from tests.live.raylets import Apart
from tests.live.test_cluster import Fronts

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.platform != "linux", reason="a cluster needs Linux"),
    pytest.mark.filterwarnings("ignore::Warning"),  # what ray itself warns of
]


@pytest.fixture
def cluster(request, monkeypatch, tmp_path) -> Iterator[Apart]:
    """Start a cluster in this mode; a process of the test that starts later has its token, if there is one."""
    pytest.importorskip("ray", reason="the extra `cluster` has no ray for this Python")
    token = tmp_path / "auth_token"
    token.write_text(secrets.token_hex(16))
    token.chmod(0o600)
    monkeypatch.setenv("RAY_AUTH_MODE", request.param)
    monkeypatch.setenv("RAY_AUTH_TOKEN_PATH", str(token))
    started = Apart()
    yield started
    started.stop()


@pytest.mark.parametrize("cluster", ["token"], indirect=True)
@fairly
def test_rooms_people_and_orders_work_where_ray_asks_for_its_token(start, tmp_path, cluster):
    assert asks_for_token(cluster.address)
    fronts = Fronts(start, tmp_path, cluster.address)
    anna = fronts.join(0, "attic", "--name", "anna")
    ben = fronts.join(1, "cellar", "--name", "ben")
    assert "2 in 2 rooms" in fronts.ask(0, "who")
    fronts.ask(1, "kick", "anna")
    anna.hear("kicked")
    assert anna.end() == 1
    ben.popen.send_signal(signal.SIGINT)
    assert ben.end() == 0, ben.said
    fronts.end()


@pytest.mark.parametrize("cluster", ["token"], indirect=True)
@fairly
def test_beyond_loopback_a_cluster_with_its_token_on_serves(start, tmp_path, cluster):
    server = start(*serving(tmp_path, cluster), "--public", "127.0.0.1")
    server.hear("room demo is served at")
    server.popen.send_signal(signal.SIGINT)
    assert server.end() == 0, server.said


@pytest.mark.parametrize("cluster", ["disabled"], indirect=True)
@fairly
def test_beyond_loopback_a_cluster_without_is_refused(start, tmp_path, cluster):
    assert not asks_for_token(cluster.address)
    server = start(*serving(tmp_path, cluster), "--public", "127.0.0.1")
    assert server.end() == 1
    assert re.search("lets in whoever reaches its ports.*RAY_AUTH_MODE=token on every host.*--insecure", server.said)
    assert "is served at" not in server.said


def serving(base: os.PathLike[str], cluster: Apart) -> list[object]:
    return [
        "serve", DEMO, "--cluster", f"ray://{cluster.address}", "--host", "0.0.0.0", "--port", free_port(), "--state",
        f"{base}/state", "--shared", f"{base}/shared", "--seconds", "120", "--no-report", "--runs", f"{base}/runs",
    ]  # fmt: skip


def test_what_cannot_be_asked_asks_for_no_token(monkeypatch):
    monkeypatch.setattr("cogrip.server.hosting.cluster.ray_token.PROBE", "import no_such_ray")
    assert not asks_for_token("127.0.0.1:1")
