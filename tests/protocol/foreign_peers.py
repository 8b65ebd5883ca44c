"""DTLS peers unlike cogrip's: old versions, other ciphers, other certificates, renegotiation."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID
from OpenSSL import SSL

from cogrip.protocol.io import dtls
from cogrip.protocol.io.certificate import Identity, fingerprint_of
from cogrip.protocol.io.dtls import Association, client_context, server_context

DTLS1_0 = 0xFEFF
COOKIE = b"c" * 16


def server_side(identity: Identity) -> SSL.Context:
    """Context of our own server, with one cookie for everyone."""
    return server_context(identity, lambda _: COOKIE, lambda _, cookie: cookie == COOKIE)


def client_side(identity: Identity) -> SSL.Context:
    """Context of our own client, which knows this server."""
    return client_context(identity.fingerprint, lambda _: None)


def foreign(
    *, version: int = dtls.DTLS1_2, ciphers: bytes = b"ALL:@SECLEVEL=0", identity: Identity | None = None
) -> SSL.Context:
    """Context of a peer that trusts everyone."""
    context = SSL.Context(SSL.DTLS_METHOD)
    context.set_min_proto_version(version)
    context.set_max_proto_version(version)
    context.set_cipher_list(ciphers)
    if identity is not None:
        context.use_certificate(identity.certificate)
        context.use_privatekey(identity.key)
        context.set_cookie_generate_callback(lambda _: COOKIE)
        context.set_cookie_verify_callback(lambda _, cookie: cookie == COOKIE)
    return context


def builder(key: Any) -> x509.CertificateBuilder:
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "peer")])
    begins = datetime.now(UTC) - timedelta(days=1)
    made = x509.CertificateBuilder(name, name, key.public_key(), 1)
    return made.not_valid_before(begins).not_valid_after(begins + timedelta(days=9))


def identity_of(key: Any, built: x509.CertificateBuilder) -> Identity:
    made = built.sign(key, hashes.SHA256())
    return Identity(key, made, fingerprint_of(made.public_bytes(Encoding.DER)))


def rsa_identity() -> Identity:
    """A certificate of the other kind."""
    key = rsa.generate_private_key(65537, 2048)
    return identity_of(key, builder(key))


def long_identity() -> Identity:
    """A certificate that takes several datagrams."""
    key = ec.generate_private_key(ec.SECP256R1())
    names = x509.SubjectAlternativeName([x509.DNSName(f"{number:02}.{'long' * 12}.example") for number in range(60)])
    return identity_of(key, builder(key).add_extension(names, critical=False))


class Pair:
    """A client and a server with nothing between them. `flights` is what each sent in turn."""

    def __init__(self, client: SSL.Context, server: SSL.Context) -> None:
        self.client = Association(client)
        self.server = Association(server, server=True)
        self.flights: list[list[bytes]] = []
        self._heard = False

    @property
    def ready(self) -> bool:
        return self.client.ready and self.server.ready

    def to_server(self, datagrams: list[bytes]) -> list[bytes]:
        """Hand datagrams over, and give what the server answers."""
        answers: list[bytes] = []
        for datagram in datagrams:
            if self._heard:
                self.server.feed(datagram)
            elif self.server.listen(datagram):
                self._heard = True
                self.server.accept()
            answers += self.server.pop_datagrams()
        return answers

    def to_client(self, datagrams: list[bytes]) -> list[bytes]:
        answers: list[bytes] = []
        for datagram in datagrams:
            self.client.feed(datagram)
            answers += self.client.pop_datagrams()
        return answers

    def shake(self, direction: Callable[[int, list[bytes]], list[bytes]] = lambda _, datagrams: datagrams) -> "Pair":
        """Let the handshake go as far as it goes. way: what arrives of a flight, by its number."""
        self.client.connect()
        datagrams = list(self.client.pop_datagrams())
        for number in range(10):
            self.flights.append(datagrams)
            datagrams = (self.to_client if number % 2 else self.to_server)(direction(number, datagrams))
            if not datagrams:
                break
        return self
