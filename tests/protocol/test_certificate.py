"""The server's identity: made once, read again, refused where it may not be used; nothing half written."""

import hashlib
import os
import ssl
import subprocess
from datetime import UTC, datetime, timedelta
from pathlib import Path
from stat import S_IMODE

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from cogrip.protocol.io.certificate import CertificateError, fingerprint_of, load, secret_of


def test_it_is_made_once_and_stays(tmp_path: Path) -> None:
    first = load(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["server.crt", "server.key"]
    assert {S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()} == {0o600}
    again = load(tmp_path)
    assert again.fingerprint == first.fingerprint
    assert again.key.private_numbers() == first.key.private_numbers()


def test_the_umask_does_not_matter(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        load(tmp_path)
    finally:
        os.umask(before)
    assert S_IMODE((tmp_path / "server.key").stat().st_mode) == 0o600


def test_the_fingerprint_is_that_of_the_certificate_s_der(tmp_path: Path) -> None:
    identity = load(tmp_path)
    der = ssl.PEM_cert_to_DER_cert((tmp_path / "server.crt").read_text())  # another reader
    assert identity.fingerprint == hashlib.sha256(der).hexdigest() == fingerprint_of(der)
    assert len(identity.fingerprint) == 64
    assert identity.fingerprint == identity.fingerprint.lower()


def test_it_lasts_for_thirty_years_and_is_an_elliptic_curve_s(tmp_path: Path) -> None:
    identity = load(tmp_path)
    now = datetime.now(UTC)
    assert identity.certificate.not_valid_before_utc < now
    assert identity.certificate.not_valid_after_utc > now + timedelta(days=30 * 365 - 2)
    assert isinstance(identity.key.curve, ec.SECP256R1)
    identity.certificate.verify_directly_issued_by(identity.certificate)


def test_two_servers_differ(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in "ab"]
    for folder in folders:
        folder.mkdir()
    assert load(folders[0]).fingerprint != load(folders[1]).fingerprint
    assert secret_of(folders[0]) != secret_of(folders[1])


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644, 0o660, 0o610, 0o601])
def test_a_key_that_others_could_read_is_refused(tmp_path: Path, mode: int) -> None:
    load(tmp_path)
    key = tmp_path / "server.key"
    key.chmod(mode)
    for use in (load, secret_of):
        with pytest.raises(CertificateError, match=f"{key} has mode 0{mode:o}.*0600 is the most.*chmod 600"):
            use(tmp_path)
    key.chmod(0o400)
    load(tmp_path)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give a file away")
def test_a_key_of_another_user_is_refused_by_root_too(tmp_path: Path) -> None:
    load(tmp_path)
    key = tmp_path / "server.key"
    os.chown(key, 12345, -1)
    for use in (load, secret_of):
        with pytest.raises(
            CertificateError, match=f"{key} belongs to user 12345, who knows it, and this is user 0; run"
        ):
            use(tmp_path)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners here")
def test_a_key_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load(tmp_path)
    mine = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    with pytest.raises(CertificateError, match=f"belongs to user {mine}, who knows it, and this is user {mine + 1}"):
        load(tmp_path)


def test_a_lost_certificate_is_named_and_nothing_is_made(tmp_path: Path) -> None:
    """Another one would make all links void, and say nothing of it."""
    load(tmp_path)
    (tmp_path / "server.crt").unlink()
    with pytest.raises(CertificateError, match=r"server\.crt is not; put the certificate back, or delete server\.key"):
        load(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["server.key"]


def test_a_lost_key_is_named_and_nothing_is_made(tmp_path: Path) -> None:
    load(tmp_path)
    (tmp_path / "server.key").unlink()
    for use in (load, secret_of):
        with pytest.raises(CertificateError, match=r"server\.key is not; put the key back, or delete server\.crt"):
            use(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["server.crt"]


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


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(CertificateError, match=r"cannot be written: No such file.*--state"):
        load(tmp_path / "nowhere")


def test_something_that_is_no_file(tmp_path: Path) -> None:
    (tmp_path / "server.key").mkdir()
    with pytest.raises(CertificateError, match=r"server\.key: Is a directory"):
        load(tmp_path)
    with pytest.raises(CertificateError, match=r"server\.key: Is a directory"):
        secret_of(tmp_path)


def test_a_start_that_is_cut_off_leaves_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", broken)
    with pytest.raises(CertificateError, match="No space left"):
        load(tmp_path)
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    load(tmp_path)


def test_the_secret_follows_from_the_key_and_does_not_give_it_away(tmp_path: Path) -> None:
    secret = secret_of(tmp_path)  # makes the key where there is none
    assert len(secret) == 32
    assert secret_of(tmp_path) == secret
    identity = load(tmp_path)
    assert secret not in (tmp_path / "server.key").read_bytes()
    assert secret != identity.key.private_numbers().private_value.to_bytes(32, "big")
    assert secret.hex() not in identity.fingerprint


def test_openssl_s_own_program_reads_both(tmp_path: Path) -> None:
    load(tmp_path)
    try:
        text = subprocess.run(
            ["openssl", "x509", "-in", tmp_path / "server.crt", "-noout", "-fingerprint", "-sha256"],
            capture_output=True, text=True, check=True,
        ).stdout  # fmt: skip
    except FileNotFoundError:
        pytest.skip("there is no openssl program here")
    assert text.partition("=")[2].strip().replace(":", "").lower() == load(tmp_path).fingerprint
