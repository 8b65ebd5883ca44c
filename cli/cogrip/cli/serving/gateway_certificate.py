"""Certificate of the gateway: one that browsers know, the server's own, or one that it makes for itself."""

import ssl
from pathlib import Path

from cogrip.cli.session.join_target import JoinTarget
from cogrip.cli.terminal.problem import BadInput
from cogrip.server.io.state_folder import NoStateError, StateError, StateFolder, find_folder, make_folder, state_path

OWN = "gateway"  # name of a folder beside those of servers


def tls_of(
    state: Path | None, certificate: Path | None, key: Path | None, target: JoinTarget, loopback: bool
) -> tuple[ssl.SSLContext | None, str]:
    """Return the TLS context and the fingerprint to compare; None where pages on loopback go without. Raises BadInput.

    The fingerprint is "" for a certificate of the user's own, which browsers know.
    """
    if (certificate is None) != (key is None):
        raise BadInput("--certificate and --key belong together: give both, or neither")
    if certificate is not None and key is not None:
        if state is not None:
            raise BadInput("--certificate and --state exclude each other; leave one out")
        return _context(certificate, key), ""
    if state is None and loopback:
        return None, ""
    with BadInput.of(StateError):
        folder, fingerprint = _server_folder(state, target) or _own_folder()
    return _context(folder.certificate, folder.key), ":".join(
        fingerprint[each : each + 2].upper() for each in range(0, len(fingerprint), 2)
    )


def _server_folder(state: Path | None, target: JoinTarget) -> tuple[StateFolder, str] | None:
    """Return the server's state folder, None where it is not here: then `state` was not given."""
    path = state_path(state, target.port)
    assert path is not None, "links have ports"
    try:
        folder = find_folder(path)
    except NoStateError:
        if state is not None:
            raise
        return None
    except StateError:
        if state is not None:
            raise
        return None  # of another user's server
    if not (folder.key.exists() and folder.certificate.exists()):
        if state is not None:
            raise BadInput(f"--state {state}: no server has left its key there; name the folder of the link's server")
        return None
    fingerprint = _fingerprint(folder)
    if fingerprint != target.fingerprint:
        if state is not None:
            raise BadInput(
                f"--state {state}: its server's certificate has the fingerprint {fingerprint[:8]}..., the link names "
                f"{target.fingerprint[:8]}...: name the folder of the link's server"
            )
        return None
    return folder, fingerprint


def _own_folder() -> tuple[StateFolder, str]:
    path = state_path(None, 1)
    assert path is not None
    folder = make_folder(path.with_name(OWN))
    return folder, _fingerprint(folder)


def _fingerprint(folder: StateFolder) -> str:
    from cogrip.protocol.io.certificate import CertificateError, load  # OpenSSL takes a while

    with BadInput.of(CertificateError):
        return load(folder.shared).fingerprint


def _context(certificate: Path, key: Path) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2

    def no_passphrase() -> str:
        raise BadInput(f"{key}: is locked by a passphrase; `openssl pkey -in {key} -out NEW` writes it without")

    try:
        context.load_cert_chain(certificate, key, no_passphrase)
    except FileNotFoundError:
        missing = certificate if not certificate.exists() else key
        raise BadInput(f"{missing}: there is no such file") from None
    except OSError as error:  # SSLError is one
        raise BadInput(
            f"{certificate}, {key}: not a certificate and its key in PEM ({error.strerror or error}); an ACME client's "
            "are called fullchain.pem and privkey.pem"
        ) from None
    return context
