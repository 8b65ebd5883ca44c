"""Who is let in: what a doorkeeper says of a hello. The doorkeeper itself is the driver's: it knows tokens and the date."""

from typing import Protocol

import msgspec

from cogrip.protocol.messages import Hello, Role


class Grant(msgspec.Struct, frozen=True, tag="grant", omit_defaults=True):
    """A hello may come in, as `role`. The texts narrow it; "" leaves open."""

    role: Role
    token: str = ""  # public id of the token, never the token
    room: str = ""
    user: str = ""  # which seat
    device: str = ""  # beginning of the device address that may be claimed, such as hid:woodenhaptics


class Denied(msgspec.Struct, frozen=True, tag="denied"):
    """It may not. The words are what both sides print."""

    code: str
    reason: str


class Authenticator(Protocol):
    """Asked once for each hello that is new, then told when a place was really given."""

    def admit(self, hello: Hello) -> Grant | Denied: ...

    def admitted(self, grant: Grant) -> None:
        """A place was given by this grant: a one-time token is used up."""
        ...


class AdmitAll:
    """Lets everyone in, as what they ask for: loopback, laboratory, or a server that was told to be open."""

    def admit(self, hello: Hello) -> Grant | Denied:
        return Grant(hello.role)

    def admitted(self, grant: Grant) -> None:
        """Nothing is used up."""
