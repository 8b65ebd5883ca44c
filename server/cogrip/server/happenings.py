"""What people and logs hear of: one happening, in words and in fields."""

import msgspec


class Happening(msgspec.Struct, frozen=True, omit_defaults=True):
    """`event` is one of EVENTS; `text` is the whole of it for people; the fields are the same for programs."""

    event: str
    text: str
    room: str = ""
    user: str = ""
    address: str = ""
    code: str = ""  # of a refusal
    token: str = ""  # public id


EVENTS = (
    "joined",
    "observes",
    "resumed",
    "left",
    "lost",
    "kicked",
    "refused",
    "restored",
    "limited",
    "stiffness",
    "reloaded",
    "trouble",
)
