"""Header of a recording, before its first message: MCAP metadata `cogrip`, text to text."""

import json
import platform
import sys
import zlib
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from typing import Annotated

import msgspec

from cogrip.protocol.settings.rates import Hz
from cogrip.protocol.texts import shown
from cogrip.protocol.version import VERSION
from cogrip.protocol.wire.messages import PROTOCOL_VERSION

NAME = "cogrip"
CUT = "cogrip.cut"
"""Name of another metadata record: the end is missing, as the loop ended before it closed the recording."""
CHECK = "check"
FORMAT = 1


class Versions(msgspec.Struct, frozen=True):
    """Versions that computed a recording: only the same ones give the same numbers again."""

    cogrip: str
    protocol: str
    python: str
    numpy: str
    machine: str

    @property
    def in_words(self) -> str:
        """The versions as text, escaped: a file may come from anybody."""
        return shown(f"cogrip {self.cogrip}, Python {self.python}, numpy {self.numpy}, {self.machine}")

    def differences(self, other: "Versions") -> list[str]:
        """Return `name: this -> other` for all that differs."""
        mine, theirs = msgspec.structs.asdict(self), msgspec.structs.asdict(other)
        return [f"{name}: {mine[name]} -> {theirs[name]}" for name in mine if mine[name] != theirs[name]]


@cache
def versions_here() -> Versions:
    """Return the versions of this process."""
    python = ".".join(map(str, sys.version_info[:3]))
    return Versions(VERSION, str(PROTOCOL_VERSION), python, version("numpy"), platform.machine())


class Header(msgspec.Struct, frozen=True):
    """role `client` or `server`; `start` is the JSON text that a core of that role was made from.

    epoch_ns   log_time of a message less its time on the recording's clock
    virtual    the clock was a laboratory's
    rate_hz    of the loop
    room       of a client
    cut        its end is missing, though the file is closed: it was recovered
    trial      what a trial of the motors found before the session, of a client; "" where there was none
    topics     by channel, from 1 on: a file whose first chunk is damaged can still be read
    """

    role: str
    who: str
    start: str
    rate_hz: Hz
    seed: int
    epoch_ns: Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
    virtual: bool
    versions: Versions
    topics: tuple[str, ...]
    room: str = ""
    cut: bool = False
    trial: str = ""
    format: int = FORMAT

    def metadata(self) -> dict[str, str]:
        """Return the header as texts, with a checksum: MCAP has none for metadata."""
        texts = {
            key: value if isinstance(value, str) else msgspec.json.encode(value).decode()
            for key, value in msgspec.structs.asdict(self).items()
        }
        return {**texts, CHECK: checksum(texts)}


def checksum(texts: dict[str, str]) -> str:
    """Return the checksum of a header's texts."""
    return str(zlib.crc32("\n".join(f"{key}={texts[key]}" for key in sorted(texts)).encode()))


def header_of(metadata: dict[str, str]) -> Header:
    """Return the header in a file's metadata. Raises ValueError (msgspec's too) if it is none, or damaged."""
    texts = {key: value for key, value in metadata.items() if key != CHECK}
    if metadata.get(CHECK) != checksum(texts):
        raise ValueError("its checksum does not fit; it is damaged")
    kinds = {field.name: field.type for field in msgspec.structs.fields(Header) if field.name in texts}
    values = {name: texts[name] if kind is str else msgspec.json.decode(texts[name]) for name, kind in kinds.items()}
    header = msgspec.convert(values, Header)
    for name in ("role", "who", "room", "trial"):
        if not getattr(header, name).isprintable():
            raise ValueError(f"its {name} holds control characters")
    try:
        with suppress(ValueError):  # whoever makes a core of it says what is wrong with it
            json.loads(header.start)
    except RecursionError:
        raise ValueError("its start is nested too deep") from None
    return header
