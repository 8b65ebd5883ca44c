"""The server's key and self-signed certificate: made on the first start, pinned by its fingerprint ever after.

`server.key` is an EC P-256 key that nobody else may read, `server.crt` its certificate. Both are PEM and are written whole or
not at all. Nobody signs for the certificate, so its name and dates mean nothing: the fingerprint in a link does.
"""

import hashlib
import os
import tempfile
from datetime import UTC, datetime, timedelta
from pathlib import Path
from stat import S_IMODE
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.kdf.hkdf import HKDF
from cryptography.x509.oid import NameOID

KEY_FILE = "server.key"
CERTIFICATE_FILE = "server.crt"
NEW = "new ones are made, and links change"
LASTS = timedelta(days=30 * 365)
BACKDATED = timedelta(days=1)
COMMON_NAME = "cogrip"
SECRET_LABEL = b"cogrip: secret of this server, 1"
SECRET_BYTES = 32
MOST_BYTES = 1 << 16  # longest key or certificate that is read


class CertificateError(Exception):
    """The key or the certificate cannot be used. The text names the file and the cure."""


class Identity(NamedTuple):
    """Key and certificate of a server. fingerprint: SHA-256 of the certificate's DER, 64 lower-case hex digits."""

    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate
    fingerprint: str


def fingerprint_of(der: bytes) -> str:
    """Return SHA-256 of a certificate's DER as 64 lower-case hex digits."""
    return hashlib.sha256(der).hexdigest()


def load(folder: Path) -> Identity:
    """Return the identity in `folder`; make one where there is none. Raises CertificateError."""
    path, had_key = folder / CERTIFICATE_FILE, (folder / KEY_FILE).exists()
    key = _key(folder)
    if had_key and not path.exists():
        raise CertificateError(
            f"{folder / KEY_FILE} is there and {path} is not; put the certificate back, or delete {KEY_FILE}: {NEW}"
        )
    try:
        certificate = x509.load_pem_x509_certificate(path.read_bytes())
    except FileNotFoundError:
        certificate = _signed(key)
        _write(path, certificate.public_bytes(serialization.Encoding.PEM))
    except OSError as error:
        raise CertificateError(f"{path}: {error.strerror}; let this user read it") from None
    except ValueError:
        raise CertificateError(f"{path} holds no certificate; delete it: a new one is made, and links change") from None
    if certificate.public_key() != key.public_key():
        raise CertificateError(
            f"{path} does not belong to {folder / KEY_FILE}; put the right one back, or delete {CERTIFICATE_FILE}: "
            "a new one is made, and links change"
        )
    return Identity(key, certificate, fingerprint_of(certificate.public_bytes(serialization.Encoding.DER)))


def secret_of(folder: Path) -> bytes:
    """Return SECRET_BYTES derived from the private key, to derive other secrets from. Raises CertificateError."""
    scalar = load(folder).key.private_numbers().private_value.to_bytes(32, "big")
    return HKDF(hashes.SHA256(), SECRET_BYTES, salt=None, info=SECRET_LABEL).derive(scalar)


def _key(folder: Path) -> ec.EllipticCurvePrivateKey:
    path = folder / KEY_FILE
    try:
        with path.open("rb") as file:
            found = os.fstat(file.fileno())
            mode, pem = S_IMODE(found.st_mode), file.read(MOST_BYTES)
    except FileNotFoundError:
        return _new_key(path)
    except OSError as error:
        raise CertificateError(f"{path}: {error.strerror}; let this user read it, and no one else") from None
    if hasattr(os, "geteuid") and found.st_uid != os.geteuid():
        raise CertificateError(
            f"{path} belongs to user {found.st_uid}, who knows it, and this is user {os.geteuid()}; run this as the former, or "
            f"delete it and {CERTIFICATE_FILE}: {NEW}"
        )
    if mode & 0o077:
        raise CertificateError(
            f"{path} has mode {mode:04o}, so others may have read it, and 0600 is the most; `chmod 600 {path}` "
            "if nobody has, else delete it: a new key is made, and links change"
        )
    try:
        key = serialization.load_pem_private_key(pem, None)
    except (ValueError, TypeError):
        key = None
    if not isinstance(key, ec.EllipticCurvePrivateKey) or not isinstance(key.curve, ec.SECP256R1):
        raise CertificateError(
            f"{path} holds no EC P-256 key without a passphrase; put the right one back, or delete it and {CERTIFICATE_FILE}: "
            f"{NEW}"
        )
    return key


def _new_key(path: Path) -> ec.EllipticCurvePrivateKey:
    certificate = path.with_name(CERTIFICATE_FILE)
    if certificate.exists():
        raise CertificateError(
            f"{certificate} is there and {path} is not; put the key back, or delete {CERTIFICATE_FILE}: {NEW}"
        )
    key = ec.generate_private_key(ec.SECP256R1())
    pem = key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    _write(path, pem)
    return key


def _signed(key: ec.EllipticCurvePrivateKey) -> x509.Certificate:
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, COMMON_NAME)])
    begins = datetime.now(UTC) - BACKDATED
    return (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begins)
        .not_valid_after(begins + LASTS)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )


def _write(path: Path, content: bytes) -> None:
    """Write all of a file or nothing, readable by this user alone."""
    try:
        number, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")  # mkstemp gives mode 0600
        try:
            with os.fdopen(number, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise CertificateError(f"{path} cannot be written: {error.strerror}; name another --state folder") from None
