"""What people and logs hear of: one happening, in words and in fields."""

import msgspec


class ServerEvent(msgspec.Struct, frozen=True, omit_defaults=True):
    """`event` is one of EVENTS; `text` is the whole of it for people; the fields are the same for programs."""

    event: str
    text: str
    room: str = ""
    user: str = ""
    address: str = ""
    code: str = ""  # of a refusal
    token: str = ""  # public id


OF_STRANGERS = (  # what people without a token can bring about, at a plain server or by handshakes: said so often at most
    "joined",
    "observes",
    "resumed",
    "left",
    "lost",
    "kicked",
    "refused",
    "limited",
    "stiffness",
)
EVENTS = (*OF_STRANGERS, "restored", "reloaded", "trouble")
