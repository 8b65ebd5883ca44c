"""`cogrip token keys` as its users type it, and revocation of signed tokens that nobody here has seen."""

import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cogrip.server.administration.orders import ReloadOrder, WhoOrder
from cogrip.server.admission.admission import Denied, Grant
from cogrip.server.admission.roster import RosterEntry
from cogrip.server.admission.signed_tokens import SignedTokens
from cogrip.server.io.state_folder import ServerRecord, StateFolder, make_folder, write_server
from cogrip.server.io.token_file import TokenFile

from tests.cli.answering_server import answering
from tests.cli.command import Cogrip
from tests.server.signers import FINGERPRINT, JTI, SECRET, Signer

READ = "the server has read it: done: ReloadOrder\n"
NOT_RUNNING = "no server is running there: it will read this at its start\n"
PEOPLE = (
    RosterEntry("anna", "lab", "192.0.2.7:5", 1.0, 0, token="came-by-this-one"),
    RosterEntry("ben", "lab", "192.0.2.7:6", 1.0, 1, token="0b9ee21b"),
    RosterEntry("carl\x1b", "lab", "192.0.2.7:7", 1.0, token="came-by-this-one"),
)


@pytest.fixture
def folder(tmp_path: Path) -> StateFolder:
    folder = make_folder(tmp_path / "state")
    write_server(folder, ServerRecord("lab.example", 47811, FINGERPRINT, {"lab": ["anna"]}, 1))
    return folder


@pytest.fixture
def token(cogrip: Cogrip, folder: StateFolder) -> Cogrip:
    """`cogrip token ... --state FOLDER`."""
    return cogrip.within("token", after=("--state", folder.path))


@pytest.fixture
def serving(folder: StateFolder) -> Iterator[list[Any]]:
    """A server that answers; gives what it was asked."""

    def answer(order: Any) -> dict[str, Any]:
        people = PEOPLE if isinstance(order, WhoOrder) else ()
        return {"text": f"done: {type(order).__name__}", "ok": True, "people": people}

    with answering(folder, answer) as orders:
        yield orders


@pytest.fixture
def public(tmp_path: Path) -> Path:
    """File of a public key."""
    path = tmp_path / "public.pem"
    path.write_bytes(Signer().pem)
    return path


def admitted(folder: StateFolder, token: str) -> Grant | Denied | None:
    """Return how a server with this folder answers now."""
    judge = SignedTokens(FINGERPRINT, time.monotonic_ns)
    return judge.admit(token, "player", "lab", TokenFile(folder).load(), time.time())


def fresh(signer: Signer, **terms: Any) -> str:
    now_s = int(time.time())
    return signer.token(iat=now_s, exp=now_s + 600, **terms)


def test_a_key_as_openssl_makes_it_lets_its_tokens_in_until_it_is_removed(token, folder, tmp_path) -> None:
    private, public = tmp_path / "signer.pem", tmp_path / "public.pem"
    subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", str(private)], check=True, timeout=60)
    subprocess.run(["openssl", "pkey", "-in", str(private), "-pubout", "-out", str(public)], check=True, timeout=60)
    out = token.out("keys", "add", public, "--kid", "uni-2026")
    assert out == f"key uni-2026 is added: its tokens are signed by EdDSA\n{NOT_RUNNING}"
    assert "it holds a private key, which stays where tokens are minted" in token.err(
        "keys", "add", private, "--kid", "x"
    )
    shown = token.out("keys", "list")
    assert shown.splitlines()[0].split() == ["kid", "algorithm", "audience", "added"]
    assert shown.splitlines()[1].startswith("uni-2026  EdDSA      the fingerprint  20")
    assert token.out("keys", "remove", "uni-2026") == f"key uni-2026 is removed\n{NOT_RUNNING}"
    assert TokenFile(folder).load().keys == ()


def test_a_running_server_is_told_of_each_change(token, folder, serving, public) -> None:
    signer = Signer()
    good = fresh(signer)
    assert isinstance(admitted(folder, good), Denied)
    assert token.out("keys", "add", public, "--kid", "uni").endswith(READ)
    assert isinstance(admitted(folder, good), Grant)
    assert token.out("keys", "remove", "uni").endswith(READ)
    assert isinstance(admitted(folder, good), Denied)
    assert serving == [ReloadOrder(), ReloadOrder()]


def test_two_keys_hold_beside_each_other(token, folder, tmp_path, public) -> None:
    (tmp_path / "secret").write_text(f"{SECRET}\n")
    token.out("keys", "add", public, "--kid", "uni")
    out = token.out("keys", "add", tmp_path / "secret", "--kid", "app", "--audience", "lab.example")
    assert "key app is added: its tokens are signed by HS256" in out
    listed = token.answer("keys", "list")
    assert [(each["kid"], each["algorithm"], each["audience"]) for each in listed["keys"]] == [
        ("uni", "EdDSA", ""), ("app", "HS256", "lab.example")
    ]  # fmt: skip
    assert SECRET not in str(listed) + token.out("keys", "list")
    assert folder.tokens.stat().st_mode & 0o777 == 0o600
    error = token.err("keys", "add", public, "--kid", "uni")
    assert (
        "token keys add: there is a key uni already; give the new one another name, or remove that one first" in error
    )
    error = token.err("keys", "remove", "app", "nui")
    assert "token keys remove: there is no key nui; there is: uni" in error
    assert len(TokenFile(folder).load().keys) == 2, "all are removed, or none"


def test_what_is_no_key_adds_none(token, folder, tmp_path) -> None:
    short = tmp_path / "short"
    short.write_text(SECRET[:40])
    error = token.err("keys", "add", short, "--kid", "k")
    assert f"token keys add: {short}: a shared secret has 160 bits at most, and at least 256 are needed" in error
    assert SECRET[:10] not in error
    assert "No such file" in token.err("keys", "add", tmp_path / "none", "--kid", "k", code=1)
    assert "name at least one key" in token.err("keys", "remove")
    assert f"no keys in {folder.path}: it takes no signed tokens" in token.texts("keys", "list")[1]
    assert not folder.tokens.exists()


def test_a_jti_is_revoked_unseen_and_stays_revoked(token, folder, public) -> None:
    signer = Signer()
    good, other = fresh(signer), fresh(signer, jti="-_begins-with-a-dash")
    assert "what is given has 16 characters" in token.err("revoke", JTI), "without a key nothing is signed"
    token.out("keys", "add", public, "--kid", "uni")
    assert isinstance(admitted(folder, good), Grant)
    assert token.out("revoke", JTI, "-_begins-with-a-dash") == (
        f"{JTI} is revoked\n-_begins-with-a-dash is revoked\n{NOT_RUNNING}"
    )
    for each in (good, other):
        denied = admitted(folder, each)
        assert isinstance(denied, Denied)
        assert "was revoked" in denied.reason
    assert token.out("revoke", JTI).startswith(f"{JTI} was revoked before\n")


def test_a_token_is_not_taken_for_an_id(token, folder, public) -> None:
    token.out("keys", "add", public, "--kid", "uni")
    link = token.texts("new")[0].strip()
    stored, signed = link.rpartition(".")[2], fresh(Signer())
    for given in (stored, signed, link):
        out, err = token.texts("revoke", given, code=2)
        assert "a token is never its own id" in err
        assert stored not in out + err
        assert signed[40:60] not in out + err
    assert TokenFile(folder).load().spent == ()


def test_the_list_shows_signed_tokens_that_are_here_or_void(token, folder, serving, public) -> None:
    token.out("keys", "add", public, "--kid", "uni")
    token.out("revoke", JTI)
    TokenFile(folder).change(lambda book: (book.spend("used-up-by-one", "use", time.time() + 60, time.time()), None))
    TokenFile(folder).change(lambda book: (book.spend("long-ago-used", "use", 1, 0), None))
    rows = [line.split() for line in token.out("list").splitlines()]
    assert rows[0] == ["signed", "(jti)", "state", "who", "expires"]
    assert [row[:3] for row in rows[1:]] == [
        ["came-by-this-one", "good", "anna,"], [JTI, "revoked", "-"], ["used-up-by-one", "used", "-"]
    ]  # fmt: skip
    listed = token.answer("list")["signed"]
    assert [(each["jti"], each["state"]) for each in listed] == [
        ("came-by-this-one", "good"), (JTI, "revoked"), ("used-up-by-one", "used")
    ]  # fmt: skip
    assert listed[0]["people"] == ["anna", "carl\x1b"]
    assert "\x1b" not in token.out("list")
