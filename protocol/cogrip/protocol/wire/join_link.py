"""Join links: `cogrip://HOST:PORT/ROOM#FINGERPRINT.TOKEN` (`SPEC.md` section 12).

The part after the # is a secret: no error, no `repr` and no `str` here shows it; only `JoinLink.text` does.
"""

import re
from ipaddress import AddressValueError, IPv6Address
from typing import Any
from urllib.parse import quote, unquote

import msgspec

from cogrip.protocol.settings.types import NAME_PATTERN
from cogrip.protocol.wire.messages import MOST_TOKEN

SCHEME = "cogrip:"
DEFAULT_PORT = 47800
FINGERPRINT_DIGITS = 64  # hexadecimal digits of a fingerprint: SHA-256 of the certificate's DER
TOKEN_CHARACTERS = 22  # characters of a token that the server made: 128 bits in base64url
SHAPE = "cogrip://HOST:PORT/ROOM#FINGERPRINT.TOKEN"
_MOST_CHARACTERS = 1200
_MOST_SHOWN = 60
_ROOM_CHARACTERS = 40  # most characters of a room's name, as in `settings.Name`
_HOST = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,252}\Z")
_FINGERPRINT = re.compile(rf"[0-9a-f]{{{FINGERPRINT_DIGITS}}}\Z")
_TOKEN = re.compile(rf"[A-Za-z0-9_-]{{{TOKEN_CHARACTERS}}}\Z")
_SIGNED = re.compile(r"[A-Za-z0-9_-]+\.[A-Za-z0-9_-]+\.[A-Za-z0-9_-]+\Z")  # a JSON Web Token in its compact form
_LONG_HEX = re.compile(r"[0-9a-fA-F]{40}")  # hexadecimal digits so many that no host has them in its name
_JOSE = "eyJ"  # beginning of a JSON object in base64url
_WRAPPING = " \t\r\n\v\f\u00a0\ufeff'\"`<>‘’‚“”„«»"
_COMMAND = re.compile(r"cogrip\s+join\s+", re.IGNORECASE)


class LinkError(ValueError):
    """Not a join link. The text names the wrong part and the cure; it shows nothing of what follows the #."""


class JoinLink(msgspec.Struct, frozen=True):
    """Address of a server, fingerprint of its certificate, and token. The constructor checks them: LinkError."""

    host: str  # name, IPv4, or IPv6 without its brackets
    port: int
    room: str  # name of the room; "" any
    fingerprint: str
    token: str

    def __post_init__(self) -> None:
        check_host(self.host)
        if not 0 < self.port < 65536:
            raise LinkError(f"join link: port {self.port} is outside 1 to 65535")
        if self.room and (len(self.room) > _ROOM_CHARACTERS or not re.match(NAME_PATTERN, self.room)):
            raise LinkError(
                f"join link: {_shown(self.room)} is no room: at most {_ROOM_CHARACTERS} letters, digits, blanks and . _ -"
                ", a letter or digit first"
            )
        if not _FINGERPRINT.match(self.fingerprint):
            raise LinkError(_cut("fingerprint", self.fingerprint, f"{FINGERPRINT_DIGITS} hexadecimal digits"))
        if not is_token(self.token):
            if "." not in self.token:
                raise LinkError(_cut("token", self.token, f"{TOKEN_CHARACTERS} letters, digits, - and _"))
            raise LinkError(
                f"join link: the signed token has {len(self.token)} characters, and must have three parts of letters, digits, "
                f"- and _, at most {MOST_TOKEN} characters with the dots; copy the whole link, and quote it: '...'"
            )

    @property
    def text(self) -> str:
        """The whole link, with its secret."""
        return f"{self._place}#{self.fingerprint}.{self.token}"

    @property
    def _place(self) -> str:
        return f"cogrip://{place_text(self.host, self.port)}/{quote(self.room, safe='')}"

    def __repr__(self) -> str:
        return f"{self._place}#{self.fingerprint[:8]}..."

    __str__ = __repr__

    def __rich_repr__(self) -> list[tuple[str, Any]]:
        return [("host", self.host), ("port", self.port), ("room", self.room)]


def is_link(text: str) -> bool:
    """Return whether `text` is meant as a join link, right or wrong: a host and a port have neither :// nor # in them."""
    return _begins_well(text.strip()) or "://" in text or "#" in text


def is_secret(text: str) -> bool:
    """Return whether `text`, no link, may hold a token or a fingerprint: then it is not to be shown or resolved."""
    last = text.rpartition(".")[2]
    mixed = any(each.islower() for each in last) and any(each.isupper() for each in last)
    signed = _SIGNED.search(text) and _JOSE in text  # a place has no such word in it
    return bool(_LONG_HEX.search(text) or signed or (_TOKEN.match(last) and ("." in text or mixed)))


def is_token(text: str) -> bool:
    """Return whether `text` has the form of a token: one that a server made, or a signed one."""
    return bool(_TOKEN.match(text)) or is_signed(text)


def is_signed(text: str) -> bool:
    """Return whether `text` has the form of a signed token."""
    return len(text) <= MOST_TOKEN and bool(_SIGNED.match(text))


def unwrapped(text: str) -> str:
    """Return pasted text without the quotes, brackets and blanks around it, and without the command before it."""
    text = text.strip(_WRAPPING)
    return text[found.end() :].strip(_WRAPPING) if (found := _COMMAND.match(text)) else text


def _begins_well(text: str) -> bool:
    return text[: len(SCHEME)].lower() == SCHEME


def parse_link(text: str) -> JoinLink:
    """Return the link that a person typed or pasted. Raises LinkError."""
    text = text.strip()
    if not _begins_well(text) or text[len(SCHEME) :][:2] != "//":
        raise LinkError(f"a join link begins with cogrip://, as in {SHAPE}; copy the whole link")
    if len(text) > _MOST_CHARACTERS:
        raise LinkError(f"join link: {len(text)} characters are more than {_MOST_CHARACTERS}; paste the link alone")
    if any(character.isspace() for character in text):
        raise LinkError(
            "join link: there is a blank or a line break in it; paste it as one line (a blank in a room is %20)"
        )
    place, _, secret = text[len(SCHEME) + 2 :].partition("#")
    if not secret:  # nothing is shown: the secret may stand anywhere
        raise LinkError(
            "join link: the part after # is missing: put the link in quotes, '...', and copy the whole of it"
        )
    fingerprint, dot, token = secret.partition(".")
    if not dot:
        raise LinkError(
            "join link: behind the # must stand FINGERPRINT.TOKEN; copy the whole link, and quote it: '...'"
        )
    authority, _, room = place.partition("/")
    host, port = split_place(authority, zone_mark="%25")
    return JoinLink(host, DEFAULT_PORT if port is None else port, unquote(room), fingerprint.lower(), token)


def split_place(text: str, zone_mark: str = "%") -> tuple[str, int | None]:
    """Return host and port of HOST, HOST:PORT, [IPV6] or [IPV6]:PORT; port None where none is given. Raises LinkError.

    zone_mark: what stands before an IPv6 zone; in a link it is %25 (RFC 6874).
    """
    if text.startswith("["):
        host, bracket, rest = text[1:].partition("]")
        if not bracket or (rest and not rest.startswith(":")):
            raise LinkError(f"{_shown(text)}: write an IPv6 address as [ADDRESS]:PORT")
        host = host.replace(zone_mark, "%", 1)
        if ":" not in host:
            raise LinkError(f"{_shown(text)}: brackets are for IPv6 addresses; leave them out")
    else:
        host, colon, rest = text.partition(":")
        rest = colon + rest
        if rest.count(":") > 1:
            raise LinkError(f"{_shown(text)}: an IPv6 address stands in brackets: [ADDRESS]:PORT")
    check_host(host)
    if not rest:
        return host, None
    digits = rest[1:]
    if not (digits.isascii() and digits.isdigit() and len(digits) <= 5 and 0 < int(digits) < 65536):
        raise LinkError(f"{_shown(text)}: the port must be a number from 1 to 65535")
    return host, int(digits)


def place_text(host: str, port: int) -> str:
    """Return HOST:PORT as it stands in a link."""
    return f"[{host.replace('%', '%25')}]:{port}" if ":" in host else f"{host}:{port}"


def check_host(host: str) -> None:
    """Check a host. Raises LinkError for what is neither a name nor an address."""
    if not host:
        raise LinkError("host: there is none; write a name or an address, such as 192.0.2.7")
    if ":" in host:
        try:
            IPv6Address(host)
        except AddressValueError:
            raise LinkError(f"host {_shown(host)}: that is no IPv6 address") from None
        zone = host.partition("%")[2]
        if zone and not re.match(r"[A-Za-z0-9._~-]{1,40}\Z", zone):
            raise LinkError(f"host {_shown(host)}: that is no IPv6 address with a zone")
    elif not _HOST.match(host):
        raise LinkError(f"host {_shown(host)}: write a name (letters, digits, . and -) or an address")


def _shown(text: str) -> str:
    return repr(text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}...")


def _cut(part: str, text: str, wanted: str) -> str:
    """Return an error text on a part that must not be shown."""
    what = f"has {len(text)} characters" if len(text) != int(wanted.split()[0]) else "has other characters"
    return f"join link: the {part} {what}, and must have {wanted}; copy the whole link, and quote it: '...'"
