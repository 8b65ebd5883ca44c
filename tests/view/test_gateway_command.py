"""`cogrip gateway` as it is typed: what it refuses before anything is served, its certificate, and the QR code."""

import os

import pytest

from cogrip.cli.main import main
from cogrip.cli.serving.gateway_certificate import tls_of
from cogrip.cli.session.join_target import JoinTarget
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.qr_code import qr_code
from cogrip.protocol.io.certificate import load
from cogrip.protocol.wire.join_link import JoinLink
from cogrip.server.io.state_folder import make_folder
from cogrip.server.io.token_file import draw_token

from tests.cli.command import Cogrip

LINK = JoinLink("127.0.0.1", 47999, "demo", "ab" * 32, draw_token()).text


@pytest.fixture
def cogrip(capsys, tmp_path, monkeypatch) -> Cogrip:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return Cogrip(main, capsys)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["127.0.0.1:47800"], "gateway: a join link is needed"),
        ([LINK, "--certificate", "c.pem"], "--certificate and --key belong together"),
        ([LINK, "--certificate", "c.pem", "--key", "k.pem"], "c.pem: there is no such file"),
        ([LINK, "--state", "nowhere"], "nowhere: there is no such folder"),
        ([LINK, "--hands", "0"], "--hands 0 must be at least 1"),
        ([LINK, "--port", "70000"], "--port 70000 is outside 0 to 65535"),
        ([LINK, "--public", "lab.example:none"], "--public lab.example:none"),
        ([LINK, "--public", "ftp://lab.example"], "--public ftp://lab.example: an origin begins with https://"),
        ([LINK, "--trust-proxy", "lab.example"], "--trust-proxy lab.example: give the proxy's address"),
    ],
)
def test_bad_input_is_one_line_before_anything_is_served(cogrip, arguments, words):
    error = cogrip.err("gateway", *arguments)
    assert words in error
    assert error.count("\n") == 1
    assert LINK.rpartition(".")[2] not in error


def target(fingerprint: str) -> JoinTarget:
    return JoinTarget("192.0.2.7", 47999, "demo", fingerprint, draw_token())


def test_the_servers_certificate_is_taken_where_it_is_that_of_the_link(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    server = load(make_folder(tmp_path / "cogrip" / "47999").path).fingerprint
    context, shown = tls_of(None, None, None, target(server), loopback=False)
    assert context is not None
    assert shown.replace(":", "").lower() == server
    assert tls_of(None, None, None, target(server), loopback=True) == (None, "")
    with pytest.raises(BadInput, match=r"the link names abababab\.\.\.: name the folder of the link's server"):
        tls_of(tmp_path / "cogrip" / "47999", None, None, target("ab" * 32), loopback=False)


def test_elsewhere_the_gateway_makes_a_certificate_and_keeps_it(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    first = tls_of(None, None, None, target("ab" * 32), loopback=False)[1]
    assert tls_of(None, None, None, target("cd" * 32), loopback=False)[1] == first
    assert os.stat(tmp_path / "cogrip" / "gateway" / "server.key").st_mode & 0o777 == 0o600


def test_files_that_are_no_certificate_and_its_key_are_named(tmp_path):
    one, other = (load(make_folder(tmp_path / name).path) and tmp_path / name for name in ("one", "other"))
    assert tls_of(None, one / "server.crt", one / "server.key", target("ab" * 32), loopback=True)[1] == ""
    with pytest.raises(BadInput, match="not a certificate and its key in PEM"):
        tls_of(None, one / "server.crt", other / "server.key", target("ab" * 32), loopback=True)


def test_a_qr_code_of_a_long_address_fits_a_terminal_of_80_by_24():
    address = f"https://haptics-laboratory-3.department.university.example:47800/#{'t' * 22}&hand"
    lines = qr_code(address, 80, 23).splitlines()
    assert 15 < len(lines) <= 23
    assert qr_code(address, 38, 23) == "no QR code: it needs 39 columns and 20 lines, and this terminal has 38 and 23"
