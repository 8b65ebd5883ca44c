"""The server's identity: made once, read again, refused where it may not be used; nothing half written."""

import hashlib
import os
import ssl
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from stat import S_IMODE

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from cogrip.protocol.io.certificate import CertificateError, fingerprint_of, load, secret_of


def test_it_is_made_once_and_stays(tmp_path: Path) -> None:
    before = os.umask(0)  # which must not matter
    try:
        first = load(tmp_path)
    finally:
        os.umask(before)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["server.crt", "server.key"]
    assert {S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()} == {0o600}
    again = load(tmp_path)
    assert again.fingerprint == first.fingerprint
    assert again.key.private_numbers() == first.key.private_numbers()
    assert isinstance(first.key.curve, ec.SECP256R1)
    now = datetime.now(UTC)
    assert first.certificate.not_valid_before_utc < now
    assert first.certificate.not_valid_after_utc > now + timedelta(days=30 * 365 - 2)
    first.certificate.verify_directly_issued_by(first.certificate)


@pytest.mark.parametrize("use", [load, secret_of])
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644, 0o660, 0o610, 0o601])
def test_a_key_that_others_could_read_is_refused(tmp_path: Path, mode: int, use: Callable[[Path], object]) -> None:
    load(tmp_path)
    key = tmp_path / "server.key"
    key.chmod(mode)
    with pytest.raises(CertificateError, match=f"{key} has mode 0{mode:o}.*0600 is the most.*chmod 600"):
        use(tmp_path)
    key.chmod(0o400)
    load(tmp_path)


@pytest.mark.parametrize("use", [load, secret_of])
@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners here")
def test_a_key_of_another_user_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, use: Callable[[Path], object]
) -> None:
    load(tmp_path)
    mine = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    with pytest.raises(CertificateError, match=f"belongs to user {mine}, who knows it, and this is user {mine + 1}"):
        use(tmp_path)


@pytest.mark.parametrize(("lost", "kept", "name"), [("crt", "key", "certificate"), ("key", "crt", "key")])
def test_a_lost_file_is_named_and_nothing_is_made(tmp_path: Path, lost: str, kept: str, name: str) -> None:
    """Another certificate would make all links void, and say nothing of it."""
    load(tmp_path)
    (tmp_path / f"server.{lost}").unlink()
    for use in (load, secret_of):
        with pytest.raises(
            CertificateError, match=rf"server\.{lost} is not; put the {name} back, or delete server\.{kept}"
        ):
            use(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [f"server.{kept}"]


def test_a_certificate_of_another_key(tmp_path: Path) -> None:
    mine, other = tmp_path / "mine", tmp_path / "other"
    for folder in (mine, other):
        folder.mkdir()
        load(folder)
    (mine / "server.crt").write_bytes((other / "server.crt").read_bytes())
    with pytest.raises(CertificateError, match="does not belong to"):
        load(mine)


@pytest.mark.parametrize(
    "content", [b"", b"nonsense", b"-----BEGIN PRIVATE KEY-----\nAAAA\n-----END PRIVATE KEY-----\n"]
)
def test_files_that_hold_something_else(tmp_path: Path, content: bytes) -> None:
    load(tmp_path)
    key = (tmp_path / "server.key").read_bytes()
    (tmp_path / "server.key").write_bytes(content)
    with pytest.raises(CertificateError, match=r"server\.key holds no EC P-256 key"):
        load(tmp_path)
    (tmp_path / "server.key").write_bytes(key)
    (tmp_path / "server.crt").write_bytes(content)
    with pytest.raises(CertificateError, match=r"server\.crt holds no certificate; delete it"):
        load(tmp_path)


@pytest.mark.parametrize("secret", [b"", b"passphrase"])
def test_keys_of_another_kind(tmp_path: Path, secret: bytes) -> None:
    key = ec.generate_private_key(ec.SECP384R1() if not secret else ec.SECP256R1())
    lock = serialization.BestAvailableEncryption(secret) if secret else serialization.NoEncryption()
    path = tmp_path / "server.key"
    path.touch(0o600)
    path.write_bytes(key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, lock))
    with pytest.raises(CertificateError, match="no EC P-256 key without a passphrase"):
        load(tmp_path)


def test_a_folder_that_is_not_there_and_a_key_that_is_one(tmp_path: Path) -> None:
    with pytest.raises(CertificateError, match=r"cannot be written: No such file.*--state"):
        load(tmp_path / "nowhere")
    (tmp_path / "server.key").mkdir()
    for use in (load, secret_of):
        with pytest.raises(CertificateError, match=r"server\.key: Is a directory"):
            use(tmp_path)


def test_a_start_that_is_cut_off_leaves_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", broken)
    with pytest.raises(CertificateError, match="No space left"):
        load(tmp_path)
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    load(tmp_path)


def test_fingerprint_and_secret_follow_from_the_key_and_do_not_give_it_away(tmp_path: Path) -> None:
    secret = secret_of(tmp_path)  # makes the key where there is none
    assert len(secret) == 32
    assert secret_of(tmp_path) == secret
    identity = load(tmp_path)
    der = ssl.PEM_cert_to_DER_cert((tmp_path / "server.crt").read_text())  # another reader
    assert identity.fingerprint == hashlib.sha256(der).hexdigest() == fingerprint_of(der)
    assert secret not in (tmp_path / "server.key").read_bytes()
    assert secret != identity.key.private_numbers().private_value.to_bytes(32, "big")
    assert secret.hex() not in identity.fingerprint
    other = tmp_path / "other"
    other.mkdir()
    assert load(other).fingerprint != identity.fingerprint
    assert secret_of(other) != secret
