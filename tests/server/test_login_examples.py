"""The programs of docs/examples/login as a university runs them: they mint what a server takes, without cogrip."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cogrip.protocol.wire.join_link import JoinLink, parse_link
from cogrip.server.admission.admission import Denied, Grant
from cogrip.server.admission.signed_tokens import MOST_LIFE_S, SignedTokens
from cogrip.server.admission.tokens import TokenBook, is_jti

from tests.server.signers import FINGERPRINT, SECRET, SecretSigner, Signer

LOGIN = Path(__file__).parents[2] / "docs" / "examples" / "login"
SERVER = f"cogrip://lab.example:47801#{FINGERPRINT}"
BOOK = TokenBook().add_key(Signer().key()).add_key(SecretSigner().key())
LIMIT_S = 60.0


@pytest.fixture
def private(tmp_path: Path) -> Path:
    """File of the private key."""
    path = tmp_path / "signer.pem"
    path.write_bytes(Signer().private_pem)
    return path


def run(*words: object, code: int = 0, **environment: str) -> tuple[str, str]:
    """Return what a program printed, which cannot import cogrip. environment: all of it"""
    hidden = "import sys; sys.modules['cogrip'] = None; import runpy; path = sys.argv[1]; sys.argv[:1] = []; "
    hidden += f"sys.path.insert(0, {str(LOGIN)!r}); runpy.run_path(path, run_name='__main__')"
    done = subprocess.run(
        [sys.executable, "-c", hidden, *map(str, words)], capture_output=True, text=True, timeout=LIMIT_S,
        env={"PATH": os.environ["PATH"], **environment},
    )  # fmt: skip
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout, done.stderr


def admitted(link: JoinLink) -> Grant | Denied | None:
    return SignedTokens(FINGERPRINT, time.monotonic_ns).admit(link.token, "player", link.room, BOOK, time.time())


def mint(key: Path, *words: object, kid: str = "uni", code: int = 0) -> tuple[str, str]:
    return run(LOGIN / "mint_token.py", key, "--kid", kid, "--server", SERVER, "--room", "room B", *words, code=code)


def test_a_minted_link_admits_to_what_was_asked_for(private: Path, tmp_path: Path) -> None:
    out, err = mint(
        private,
        "--seat",
        "anna",
        "--device",
        "sim:",
        "--force-n",
        9,
        "--once",
        "--sub",
        "a@uni.example",
        "--seconds",
        MOST_LIFE_S,
    )
    link = parse_link(out)
    jti = err.split()[1]
    assert is_jti(jti)
    assert (link.host, link.port, link.room, link.fingerprint) == ("lab.example", 47801, "room B", FINGERPRINT)
    assert admitted(link) == Grant("player", jti, "room B", "anna", "sim:", 9.0)
    (tmp_path / "secret").write_text(f"{SECRET}\n")
    out, err = mint(tmp_path / "secret", "--role", "observer", kid="app")
    assert admitted(parse_link(out)) == Grant("observer", err.split()[1], "room B")


def test_what_no_server_would_take_is_not_minted(private: Path) -> None:
    for words, why in (
        (("--seconds", MOST_LIFE_S + 1), "86401 s are no life of a token: 1 to 86400"),
        (("--seconds", 0), "0 s are no life of a token"),
        (("--sub", "s" * 200), "characters, more than 640: shorten sub, device or kid"),
    ):
        out, err = mint(private, *words, code=2)
        assert out == ""
        assert why in err


def page(private: Path, **environment: str) -> tuple[str, str]:
    """Return the answer of the page and its log, with the environment that a web server gives a CGI program."""
    return run(
        LOGIN / "login_page.py", COGRIP_SIGNER=str(private), COGRIP_KID="uni", COGRIP_SERVER=SERVER, COGRIP_ROOM="lab",
        COGRIP_PLAYERS="haptics", GATEWAY_INTERFACE="CGI/1.1", REQUEST_METHOD="GET", SERVER_NAME="join.uni.example",
        SERVER_PORT="443", SERVER_PROTOCOL="HTTP/1.1", SCRIPT_NAME="/join", **environment,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("groups", "role"),
    [("staff,haptics", "player"), ("haptics", "player"), ("staff", "observer"), ("haptics-2,no haptics2", "observer")],
)
def test_whoever_has_logged_in_gets_a_link_by_their_groups(private: Path, groups: str, role: str) -> None:
    out, err = page(private, REMOTE_USER="zoë@uni.example\x1b[2J", OIDC_CLAIM_groups=groups)
    assert out.startswith("Status: 200 OK\n")
    assert "Cache-Control: no-store" in out
    found = re.search(r"cogrip join &#x27;(.*?)&#x27;|cogrip join '(.*?)'", out)
    assert found, out
    link = parse_link(found[1] or found[2])
    grant = admitted(link)
    assert isinstance(grant, Grant)
    assert (grant.role, grant.room) == (role, "lab")
    assert f"gets token {grant.token} as {role}" in err
    assert "\x1b" not in err
    assert link.token not in err


def test_nobody_who_has_not_logged_in_gets_one_and_a_header_names_no_group(private: Path) -> None:
    out, _ = page(private)
    assert out.startswith("Status: 403 Forbidden\n")
    assert "cogrip://" not in out
    out, _ = page(private, REMOTE_USER="zoe", HTTP_OIDC_CLAIM_GROUPS="haptics", HTTP_REMOTE_USER="anna")
    assert "Join as observer" in out
