"""Signed tokens: what a good one admits to, and an attack a row, each refused with one line that says why."""

import json
import subprocess
import warnings
from typing import Any

import jwt
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from joserfc import jwt as jose
from joserfc.jwk import OctKey, OKPKey

from cogrip.protocol.wire.messages import MOST_TOKEN
from cogrip.server.admission import signed_tokens
from cogrip.server.admission.admission import Denied, Grant
from cogrip.server.admission.signed_tokens import LEEWAY_S, MOST_KNOWN, MOST_LIFE_S, SignedTokens
from cogrip.server.admission.token_keys import read_keys
from cogrip.server.admission.tokens import MOST_ONCE, MOST_SPENT, SPENT_S, TokenBook, TokenError, is_jti
from cogrip.server.rate_limit import SIGNATURES

from tests.protocol.spec_page import section
from tests.server.signers import FINGERPRINT, JTI, NOW_S, SECRET, SecretSigner, Signer, claims, part

UNI, APP = Signer(), SecretSigner()
BOOK = TokenBook().add_key(UNI.key()).add_key(APP.key("lab.example"))


class Desk:
    """A judge with a virtual clock, and its book."""

    def __init__(self, book: TokenBook = BOOK) -> None:
        self.book, self.clock_ns = book, 0
        self.judge = SignedTokens(FINGERPRINT, lambda: self.clock_ns)

    def admit(self, token: str, role: Any = "player", room: str = "", now_s: float = NOW_S) -> Grant | Denied | None:
        return self.judge.admit(token, role, room, self.book, now_s)

    def why_not(self, token: str, now_s: float = NOW_S) -> str:
        """Return why a token is refused. It resumes nothing either."""
        denied = self.admit(token, now_s=now_s)
        assert isinstance(denied, Denied), denied
        assert self.judge.shown(token, self.book, now_s) is None or "one time" in denied.reason
        assert denied.code == "token"
        assert denied.reason.startswith("this token ")
        assert denied.reason.endswith("; ask for a new link")
        assert "\n" not in denied.reason
        return denied.reason.removeprefix("this token ").removesuffix("; ask for a new link")


@pytest.mark.parametrize("signer", [UNI, APP])
def test_a_token_admits_to_what_it_says(signer: Signer) -> None:
    desk = Desk()
    token = signer.token(seat="anna", device="hid:", sub="a.b@uni.example", iss="https://login.uni.example", nbf=NOW_S)
    assert desk.admit(token) == Grant("player", JTI, "lab", "anna", "hid:")
    assert desk.admit(token, "observer") == Grant("observer", JTI, "lab")
    assert desk.admit(token, room="wall") == Denied(
        "room", "this token is for room 'lab', not 'wall'; use the link as it is"
    )
    assert desk.judge.shown(token, desk.book, NOW_S) == JTI
    watches = signer.token(role="observer", room="", jti="another-one")
    assert desk.admit(watches, "player", "wall") == Grant("observer", "another-one")


def test_it_bounds_the_device_record_of_a_player() -> None:
    token = UNI.token(force_n=3, speed_mps=0.5)
    assert Desk().admit(token) == Grant("player", JTI, "lab", force_n=3.0, speed_mps=0.5)
    assert Desk().admit(token, "observer") == Grant("observer", JTI, "lab")


@pytest.mark.parametrize(("name", "signer"), [(FINGERPRINT, UNI), (FINGERPRINT, APP), ("lab.example", APP)])
def test_it_is_for_the_fingerprint_or_the_name_that_was_given_with_its_key(name: str, signer: Signer) -> None:
    assert isinstance(Desk().admit(signer.token(aud=name)), Grant)


def test_the_vector_of_the_page() -> None:
    text = section("15.5").partition("A signed token:")[2]
    x, token = text.split("`")[1], ".".join(text.split("```")[1].split())
    (key,) = read_keys(json.dumps({"kty": "OKP", "crv": "Ed25519", "x": x, "kid": "rfc8037"}).encode(), "", "", NOW_S)
    assert Desk(TokenBook(keys=(key,))).admit(token, now_s=NOW_S + 100) == Grant("player", JTI, "lab", "anna")


# --- what others mint -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ["EdDSA", "Ed25519"])
def test_another_library_mints_with_a_key_of_its_own(algorithm: str) -> None:
    key = OKPKey.generate_key("Ed25519", {"kid": "jose"})
    (kept,) = read_keys(json.dumps(key.as_dict(private=False)).encode(), "", "", NOW_S)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it says that RFC 9864 has another name for EdDSA
        token = jose.encode({"alg": algorithm, "kid": "jose"}, claims(), key, algorithms=[algorithm])
    assert isinstance(Desk(BOOK.add_key(kept)).admit(token), Grant)
    assert "by a key that this server does not know ('jose')" in Desk().why_not(token)


def test_another_library_mints_with_a_shared_secret() -> None:
    key = OctKey.import_key(SECRET)
    assert isinstance(Desk().admit(jose.encode({"alg": "HS256", "kid": "app"}, claims(), key)), Grant)


def test_pyjwt_mints() -> None:
    made = jwt.encode(claims(), UNI.private, "EdDSA", headers={"kid": "uni"})
    assert made == UNI.token(header={"alg": "EdDSA", "kid": "uni", "typ": "JWT"})
    assert isinstance(Desk().admit(made), Grant)
    assert isinstance(Desk().admit(jwt.encode(claims(), SECRET, "HS256", headers={"kid": "app"})), Grant)


def test_openssl_alone_mints(tmp_path) -> None:
    """A shell script can: its key is made, its public key given away, and its bytes are signed by openssl."""

    def openssl(*words: object) -> bytes:
        return subprocess.run(["openssl", *map(str, words)], check=True, capture_output=True, timeout=60).stdout

    private, signed = tmp_path / "signer.pem", tmp_path / "signed"
    openssl("genpkey", "-algorithm", "ed25519", "-out", private)
    (kept,) = read_keys(openssl("pkey", "-in", private, "-pubout"), "shell", "", NOW_S)
    parts = f"{part({'alg': 'EdDSA', 'kid': 'shell'})}.{part(claims())}"
    signed.write_bytes(parts.encode())
    signature = openssl("pkeyutl", "-sign", "-inkey", private, "-rawin", "-in", signed)
    assert isinstance(Desk(BOOK.add_key(kept)).admit(f"{parts}.{part(signature)}"), Grant)


# --- attacks: one a row -----------------------------------------------------------------------------------------------

STRANGER = Signer(seed=2)
PUBLIC_AS_SECRET = SecretSigner("uni", UNI.pem)
RAW_AS_SECRET = SecretSigner("uni", UNI.key().bytes)
GOOD = UNI.token()
HEAD, BODY, SIGNATURE = GOOD.split(".")


def header(**changed: Any) -> str:
    return UNI.token(header=UNI.header(**changed))


ATTACKS = {
    "no algorithm": (f"{part(UNI.header(alg='none'))}.{BODY}.", "signed by none, and the key 'uni' is for EdDSA"),
    "no algorithm, a signature": (header(alg="none"), "signed by none, and the key 'uni' is for EdDSA"),
    "no algorithm, in other letters": (header(alg="nOnE"), "signed by nOnE, and the key"),
    "the public key as a secret": (PUBLIC_AS_SECRET.token(), "signed by HS256, and the key 'uni' is for EdDSA"),
    "its 32 bytes as a secret": (RAW_AS_SECRET.token(), "signed by HS256, and the key 'uni' is for EdDSA"),
    "that, called EdDSA": (RAW_AS_SECRET.token(header=UNI.header()), "has no signature by the key 'uni'"),
    "EdDSA by the secret's name": (UNI.token(header=UNI.header(kid="app")), "signed by EdDSA, and the key 'app' is for HS256"),
    "HS512 by the secret": (APP.token(header=APP.header(alg="HS512")), "signed by HS512, and the key 'app' is for HS256"),
    "an algorithm that is a list": (header(alg=["EdDSA"]), "another header than alg, kid and typ"),
    "an algorithm with a line break": (header(alg="a\nb"), "signed by something else"),
    "another one's key": (STRANGER.token(), "has no signature by the key 'uni'"),
    "another secret": (SecretSigner(secret=b"6f" * 32).token(), "has no signature by the key 'app'"),
    "an unknown key": (Signer("who").token(), "by a key that this server does not know ('who')"),
    "no name of a key": (header(kid=None), "another header than alg, kid and typ"),
    "a name of a path": (header(kid="../../dev/null"), "does not know (of a name that no key has)"),
    "a name of a statement": (header(kid="x' UNION SELECT 'k"), "does not know (of a name that no key has)"),
    "a key of its own in the header": (header(jwk={"kty": "OKP", "crv": "Ed25519", "x": "A" * 43}), "another header than"),
    "an address of keys": (header(jku="https://evil.example/keys"), "another header than"),
    "a header that is critical": (header(crit=["exp"], exp=1), "another header than"),
    "bytes that are not encoded": (header(b64=False, crit=["b64"]), "another header than"),
    "a compressed one": (header(zip="DEF"), "another header than"),
    "a header that is no JSON": (f"{part(b'{')}.{BODY}.{SIGNATURE}", "another header than"),
    "a header of brackets": (f"{part(b'[' * 150)}.{BODY}.{SIGNATURE}", "another header than"),
    "a header that is no text": (f"{part(bytes([0xFF] * 9))}.{BODY}.{SIGNATURE}", "another header than"),
    "a changed claim": (f"{HEAD}.{part(claims(role='observer'))}.{SIGNATURE}", "has no signature"),
    "a changed header": (f"{part({'alg': 'EdDSA', 'kid': 'uni'})}.{BODY}.{SIGNATURE}", "has no signature"),
    "a shorter signature": (GOOD[:-4], "has no signature"),
    "no signature": (f"{HEAD}.{BODY}.", "has no signature"),
    "two parts": (f"{HEAD}.{BODY}", "has 2 parts, and a signed one has three"),
    "four parts": (f"{GOOD}.x", "has 4 parts"),
    "an encrypted one": (f"{HEAD}.a.b.c.d", "has 5 parts"),
    "dots": ("..", "another header than"),
    "a dot": (".", "has 2 parts"),
    "another server": (UNI.token(aud="fedcba9876543210" * 4), "is for another server (aud)"),
    "another key's name for the server": (UNI.token(aud="lab.example"), "is for another server (aud)"),
    "a beginning of the fingerprint": (UNI.token(aud=FINGERPRINT[:32]), "is for another server (aud)"),
    "no server": (UNI.token(aud=""), "cannot be: aud: Expected `str` of length >= 1"),
    "many servers": (UNI.token(aud=[FINGERPRINT]), "cannot be: aud: Expected `str`, got `array`"),
    **{f"without {name}": (UNI.token(**{name: None}), f"missing required field `{name}`") for name in claims()},
    "an unknown claim": (UNI.token(seats="anna"), "contains unknown field `seats`"),
    "an end that is a text": (UNI.token(exp=str(NOW_S + 60)), "cannot be: exp: Expected `int`, got `str`"),
    "an end with a point": (UNI.token(exp=NOW_S + 60.5), "cannot be: exp: Expected `int`, got `float`"),
    "an end that is infinite": (UNI.token(json.dumps(claims(exp=float("inf"))).encode()), "cannot be: "),
    "an end that is huge": (UNI.token(json.dumps(claims()).replace(str(NOW_S + 600), "1e400").encode()), "cannot be: exp"),
    "an end after all years": (UNI.token(exp=10**12), "cannot be: exp: Expected `int` <= 253402300799"),
    "an end below 0": (UNI.token(exp=-1), "cannot be: exp: Expected `int` >= 0"),
    "a truth as an end": (UNI.token(exp=True), "cannot be: exp: Expected `int`, got `bool`"),
    "a number as a room": (UNI.token(room=7), "cannot be: room: Expected `str`, got `int`"),
    "a room that is none": (UNI.token(room="a/b"), "cannot be: room: Expected `str` matching regex"),
    "a long room": (UNI.token(room="r" * 41), "cannot be: room: Expected `str` of length <= 40"),
    "a line break in a name": (UNI.token(seat="anna\nben"), "cannot be: seat: Expected `str` matching regex"),
    "a line break at its end": (UNI.token(seat="anna\n"), "cannot be: seat: Expected `str` matching regex"),
    "an escape sequence": (UNI.token(seat="\x1b[2J"), "cannot be: seat: Expected `str` matching regex"),
    "a letter of another script": (UNI.token(seat="аnna"), "cannot be: seat: Expected `str` matching regex"),
    "a name that runs backwards": (UNI.token(seat="a\u202enna"), "cannot be: seat: Expected `str` matching regex"),
    "a half of a letter": (UNI.token(seat="a\ud800"), "cannot be: "),
    "a zero in a device": (UNI.token(device="hid:\x00"), "cannot be: device: Expected `str` matching regex"),
    "a role that is none": (UNI.token(role="admin"), "cannot be: role: Invalid enum value 'admin'"),
    "a force below 0": (UNI.token(force_n=-1.0), "cannot be: force_n: Expected `float` >= 0.0"),
    "a text as a force": (UNI.token(force_n="3"), "cannot be: force_n: Expected `float`, got `str`"),
    "a speed beyond all": (UNI.token(speed_mps=1e7), "cannot be: speed_mps: Expected `float` <= 1000000.0"),
    "a word for once": (UNI.token(once="yes"), "cannot be: once: Expected `bool`, got `str`"),
    "a short id": (UNI.token(jti="abcdefghi"), "cannot be: jti: Expected `str` matching regex"),
    "an id of a stored token": (UNI.token(jti="0b9ee21b"), "cannot be: jti: Expected `str` matching regex"),
    "an id with a blank": (UNI.token(jti="abcdefghij k"), "cannot be: jti: Expected `str` matching regex"),
    "claims in a list": (UNI.token([claims()]), "cannot be: claims: Expected `object`, got `array`"),
    "claims of brackets": (UNI.token(b"[" * 250), "cannot be: "),
    "claims that are no JSON": (UNI.token(b"{"), "cannot be: "),
    "claims that are no text": (UNI.token(b'{"aud":"\xff"}'), "cannot be: "),
    "a life of a day and a second": (UNI.token(exp=NOW_S + MOST_LIFE_S + 1), "is good for 86401 s, and at most 86400"),
    "a life of ten years, nearly over": (UNI.token(iat=NOW_S - 315_360_000), "and at most 86400 s are allowed"),
    "an end before its beginning": (UNI.token(iat=NOW_S, exp=NOW_S - 60), "has expired, at 2027-01-15 07:59 UTC"),
}  # fmt: skip


@pytest.mark.parametrize("attack", ATTACKS)
def test_each_attack_is_refused_in_words(attack: str) -> None:
    token, words = ATTACKS[attack]
    desk = Desk()
    assert words in desk.why_not(token)
    assert isinstance(desk.admit(GOOD), Grant), "a good one is taken all the same"


def test_the_longest_token_is_taken_and_no_longer_one() -> None:
    tokens = [UNI.token(sub="s" * size, iss="i" * 20) for size in range(201)]
    longest = max((token for token in tokens if len(token) <= MOST_TOKEN), key=len)
    longer = min((token for token in tokens if len(token) > MOST_TOKEN), key=len)
    assert len(longer) - len(longest) <= 2, "base64 has no texts of every length"
    assert isinstance(Desk().admit(longest), Grant)
    assert f"has {len(longer)} characters, and at most 640 fit a hello" in Desk().why_not(longer)


@pytest.mark.parametrize("name", ["iat", "nbf"])
def test_both_sides_of_when_a_token_begins(name: str) -> None:
    token = UNI.token(**{name: NOW_S + LEEWAY_S, "exp": NOW_S + 600})
    assert isinstance(Desk().admit(token, now_s=NOW_S), Grant)
    assert "is good from 2027-01-15 08:00 UTC on, and here it is 2027-01-15 07:59" in Desk().why_not(
        token, NOW_S - 0.01
    )


def test_both_sides_of_its_end() -> None:
    desk, token = Desk(), UNI.token()
    assert isinstance(desk.admit(token, now_s=NOW_S + 600 + LEEWAY_S - 0.01), Grant)
    assert "has expired, at 2027-01-15 08:10 UTC" in desk.why_not(token, NOW_S + 600 + LEEWAY_S), (
        "also one that is remembered"
    )
    assert isinstance(desk.admit(UNI.token(exp=NOW_S + MOST_LIFE_S)), Grant), "a day"


@given(st.text(st.characters(codec="utf-8"), max_size=80), st.integers(0, len(GOOD)), st.integers(0, 3))
@example("", 0, 0)
def test_any_text_and_any_slip_in_a_token_is_refused_or_harmless(instead: str, at: int, without: int) -> None:
    """Base64 has bits that say nothing: a token may be written in several ways, which all have its id."""
    token = GOOD[:at] + instead + GOOD[at + without :]
    answer = Desk().admit(token)
    assert isinstance(answer, Denied) or answer == Desk().admit(GOOD)
    assert isinstance(Desk().admit(instead + "."), Denied)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(st.sampled_from([*claims(), "seat", "device", "once", "nbf", "sub", "iss", "x"]), json_values)
def test_any_signed_claim_is_refused_or_admits_within_its_type(name: str, value: object) -> None:
    token = UNI.token(content={**claims(), name: value})
    answer = Desk().admit(token)
    if isinstance(answer, Grant):
        assert answer.role in ("player", "observer")
        assert is_jti(answer.token)
        assert all(text.isascii() and text.isprintable() for text in (answer.room, answer.user, answer.device))
    else:
        assert isinstance(answer, Denied)


# --- replay -----------------------------------------------------------------------------------------------------------


def test_a_revoked_token_is_void_and_stays_so_until_it_has_expired() -> None:
    desk, token = Desk(), UNI.token(iat=NOW_S + LEEWAY_S, exp=NOW_S + LEEWAY_S + MOST_LIFE_S)
    assert isinstance(desk.admit(token), Grant), "the token that lasts longest of all"
    desk.book = desk.book.spend(JTI, "revoke", NOW_S + SPENT_S, NOW_S)
    assert desk.why_not(token) == "was revoked at 2027-01-15 08:00 UTC"
    assert "was revoked" in desk.why_not(UNI.token(exp=NOW_S + 60, room="wall")), "another one with the same id"
    last_s = NOW_S + 2 * LEEWAY_S + MOST_LIFE_S - 0.01
    others = desk.book.spend("some-other-one", "revoke", last_s + 60, last_s)
    assert others.spent_of(JTI) is not None, "it is not forgotten before"
    assert others.spend("a-later-one", "revoke", last_s + 60, last_s + 2).spent_of(JTI) is None


def test_a_token_for_one_time_admits_nobody_once_it_was_used_and_still_resumes() -> None:
    desk, token = Desk(), UNI.token(once=True)
    assert isinstance(desk.admit(token), Grant)
    until_s = desk.judge.used_until(JTI, NOW_S)
    assert until_s == NOW_S + 600 + LEEWAY_S
    desk.book = desk.book.spend(JTI, "use", until_s, NOW_S)
    assert desk.why_not(token) == "was used already: it is good for one time"
    assert desk.judge.shown(token, desk.book, NOW_S) == JTI
    desk.book = desk.book.spend(JTI, "revoke", until_s, NOW_S + 1)
    assert desk.judge.shown(token, desk.book, NOW_S) is None


def test_a_standing_token_is_not_used_up_and_one_that_is_forgotten_is_taken_for_one_of_one_time() -> None:
    desk = Desk()
    desk.admit(UNI.token())
    assert desk.judge.used_until(JTI, NOW_S) is None
    assert desk.judge.used_until("never-seen-here", NOW_S) == NOW_S + SPENT_S
    desk.admit(UNI.token(once=True))
    assert desk.judge.used_until(JTI, NOW_S) == NOW_S + 600 + LEEWAY_S, (
        "two tokens with one id: the stricter one counts"
    )


def test_a_full_book_takes_no_token_of_one_time_and_no_revocation_is_lost() -> None:
    desk = Desk()
    for number in range(MOST_ONCE):
        desk.book = desk.book.spend(f"token-{number:05}", "use", NOW_S + 60, NOW_S)
    assert "no more of those can be remembered here" in desk.why_not(UNI.token(once=True))
    assert isinstance(desk.admit(UNI.token()), Grant), "a standing one needs no memory"
    assert isinstance(desk.admit(UNI.token(once=True), now_s=NOW_S + 61), Grant), "once others have expired"
    for number in range(MOST_ONCE, MOST_SPENT):
        desk.book = desk.book.spend(f"token-{number:05}", "revoke", NOW_S + 60, NOW_S)
    with pytest.raises(TokenError, match=r"2000 signed tokens are kept.* remove the key"):
        desk.book.spend(JTI, "revoke", NOW_S + 60, NOW_S)
    assert len(desk.book.spend(JTI, "revoke", NOW_S + 160, NOW_S + 62).spent) == 1


# --- keys that change -------------------------------------------------------------------------------------------------


def test_two_keys_hold_beside_each_other_and_one_that_is_removed_ends_its_tokens() -> None:
    new = Signer("uni-2", seed=3)
    desk, old_token, new_token = Desk(), UNI.token(), new.token(jti="by-the-new-one")
    assert "does not know ('uni-2')" in desk.why_not(new_token)
    desk.book = desk.book.add_key(new.key())
    assert isinstance(desk.admit(old_token), Grant)
    assert isinstance(desk.admit(new_token), Grant)
    assert desk.judge.void(desk.book) == set()
    desk.book = desk.book.remove_key("uni")
    assert desk.judge.void(desk.book) == {JTI}
    assert "does not know ('uni')" in desk.why_not(old_token), "also where its signature was right before"
    assert isinstance(desk.admit(new_token), Grant)
    desk.book = desk.book.add_key(Signer("uni", seed=4).key())
    assert desk.judge.void(desk.book) == {JTI}, "another key of the same name"
    assert "has no signature by the key 'uni'" in desk.why_not(old_token)


def test_a_server_without_keys_takes_no_signed_token_and_computes_nothing() -> None:
    desk = Desk(TokenBook())
    for _ in range(SIGNATURES.burst + 1):
        assert desk.why_not(GOOD) == "is a signed one, and this server has no key for those"


# --- what they cost ---------------------------------------------------------------------------------------------------


def test_a_flood_of_wrong_signatures_has_a_budget_and_costs_nobody_a_place_who_is_known(monkeypatch) -> None:
    checked = []
    check = signed_tokens.check_signature
    monkeypatch.setattr(signed_tokens, "check_signature", lambda *args: checked.append(args) or check(*args))
    desk = Desk()
    assert isinstance(desk.admit(GOOD), Grant)
    wrong = [STRANGER.token(jti=f"wrong-token-{number}") for number in range(2 * SIGNATURES.burst)]
    answers = [desk.admit(token) for token in wrong]
    assert sum(isinstance(each, Denied) for each in answers) == len(checked) - 1 == SIGNATURES.burst - 1
    assert answers[-1] is None
    assert isinstance(desk.admit(GOOD), Grant)
    assert desk.judge.shown(GOOD, desk.book, NOW_S) == JTI, "whoever comes back needs no signature checked"
    newcomer = UNI.token(jti="a-newcomer")
    assert desk.admit(newcomer) is None
    assert desk.judge.shown(newcomer, desk.book, NOW_S) is None
    desk.clock_ns += 10**9 // SIGNATURES.per_second + 1
    assert isinstance(desk.admit(newcomer), Grant)


def test_only_so_many_are_remembered(monkeypatch) -> None:
    desk = Desk()
    signed = signed_tokens.check_signature(GOOD, BOOK)
    monkeypatch.setattr(signed_tokens, "check_signature", lambda token, book: signed)
    for number in range(MOST_KNOWN + 5):
        desk.clock_ns += 10**9
        desk.admit(f"{number}..")
    assert len(desk.judge._known) == MOST_KNOWN
