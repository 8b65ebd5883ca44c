"""First message of a client of the view's socket, and the other texts that it may send (`docs/view.md`)."""

from typing import Annotated

import msgspec

from cogrip.experiments.study.questions import MOST_TEXT
from cogrip.protocol.wire.messages import MOST_TOKEN

MOST_CHUNK = 2**20
MOST_NUMBER = 2**31 - 1


class PageHello(msgspec.Struct, frozen=True, tag_field="type", tag="hello", forbid_unknown_fields=True):
    """hand: ask for a device to move, where there is one."""

    token: Annotated[str, msgspec.Meta(max_length=MOST_TOKEN)]
    hand: bool = False


class ChunkRequest(msgspec.Struct, frozen=True, tag_field="type", tag="chunk", forbid_unknown_fields=True):
    """Request for a chunk of a recording."""

    number: Annotated[int, msgspec.Meta(ge=0, le=MOST_CHUNK)]


class PanelReply(msgspec.Struct, frozen=True, tag_field="type", tag="reply", forbid_unknown_fields=True):
    """Reply of a study's participant to the prompt of this number."""

    number: Annotated[int, msgspec.Meta(ge=0, le=MOST_NUMBER)]
    text: Annotated[str, msgspec.Meta(max_length=MOST_TEXT)]


PageText = PageHello | ChunkRequest | PanelReply


class PageError(ValueError):
    """A text that is none of this page's."""


_decoder: msgspec.json.Decoder[PageText] = msgspec.json.Decoder(PageText)


def read_text(text: str | bytes) -> PageText:
    """Return the message in a text. Raises PageError."""
    try:
        return _decoder.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise PageError(str(error)) from None
