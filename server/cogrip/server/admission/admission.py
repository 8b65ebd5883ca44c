"""Admission: the answer to a hello. The loop around the core passes in `AdmissionServices`: the authenticator, which knows
tokens and the date, and the source of random numbers.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import msgspec

from cogrip.protocol.wire.messages import Hello, Role


class Grant(msgspec.Struct, frozen=True, tag="grant", omit_defaults=True):
    """Admission as `role`. The other fields narrow it; "" and 0 leave open."""

    role: Role
    token: str = ""  # public id of the token, never the token
    room: str = ""
    user: str = ""  # name of the person whose seat may be taken
    device: str = ""  # beginning of the device address that may be claimed, such as hid:woodenhaptics
    force_n: float = 0.0  # most force and speed that the device record may claim
    speed_mps: float = 0.0


class Denied(msgspec.Struct, frozen=True, tag="denied"):
    """Refusal; both ends print the reason."""

    code: str
    reason: str


class Authenticator(Protocol):
    """Decides on admission."""

    def admit(self, hello: Hello) -> Grant | Denied | None:
        """Answer a hello that is new: called once for each. None where that is not known yet: the hello comes again."""

    def shown(self, hello: Hello) -> str | None:
        """Return the public id of the hello's token, by which a session that it admitted may be resumed: also of one that
        was good for one time. None where it is unknown, revoked or expired; "" where nobody is asked for one.
        """

    def admitted(self, grant: Grant) -> None:
        """Record that a seat or observer slot was given by this grant, which uses up a one-time token."""


class AdmitAll:
    """Admits everybody as what they ask for: loopback, laboratory, or a server that was told to be open."""

    def admit(self, hello: Hello) -> Grant | Denied:
        return Grant(hello.role)

    def shown(self, hello: Hello) -> str | None:
        return ""

    def admitted(self, grant: Grant) -> None:
        """Nothing is used up."""


@dataclass(frozen=True, slots=True)
class AdmissionServices:
    """Authentication and random numbers that the loop passes into a server core, which has no access to files or the system.

    new_session    returns a random session number from 1 to 2^63 - 1
    authenticator  decides on hellos by token
    new_ticket     returns a new session ticket, the secret that resumes a session; "" where sessions cannot be resumed
    hash_ticket    returns the ticket hash, which is stored in place of the ticket
    """

    new_session: Callable[[], int]
    authenticator: Authenticator = field(default_factory=AdmitAll)
    new_ticket: Callable[[], str] = str
    hash_ticket: Callable[[str], str] = str
