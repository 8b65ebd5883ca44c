"""Events of a server, for people and logs."""

import msgspec


class ServerEvent(msgspec.Struct, frozen=True, omit_defaults=True):
    """event: one of EVENTS; text: all of it, for people; the other fields say the same to programs."""

    event: str
    text: str
    room: str = ""
    user: str = ""
    address: str = ""
    code: str = ""  # code of a refusal
    token: str = ""  # public id of the token


UNAUTHENTICATED_EVENTS = (
    "joined", "observes", "resumed", "left", "lost", "kicked", "refused", "limited", "stiffness", "marker", "hand", "trigger",
)  # fmt: skip
"""Events that unauthenticated peers can cause, at an unencrypted server or by handshakes: a log gets a bounded number."""

EVENTS = (*UNAUTHENTICATED_EVENTS, "restored", "reloaded", "opened", "closed", "trouble")
