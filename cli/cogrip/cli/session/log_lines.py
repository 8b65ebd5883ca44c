"""What a server says, on standard output: lines for people, or one JSON object a line for programs."""

import errno
import json
import os
import select
import sys
from collections.abc import Callable
from datetime import datetime
from typing import Literal, TextIO

from cogrip.protocol.messages import shown
from cogrip.server.events import ServerEvent

WARNINGS = ("lost", "kicked", "refused", "limited", "stiffness", "trouble")  # events; the others are good
FIELDS = ("room", "user", "address", "code", "token")
LONGEST_BYTES = 4096  # a pipe takes so much whole, or says beforehand that it will not
LONGEST_TEXT = 1000  # characters; nothing that is said is longer, only what somebody made us say
NOTICE = "notice"  # the event of plain words


def now() -> datetime:
    """This moment, with this place's offset from UTC."""
    return datetime.now().astimezone()


class LogLines:
    """`say` a happening or plain words. A reader who is gone, or does not read, never holds or ends the server: `lost` counts
    the lines that found none.
    """

    def __init__(
        self, form: Literal["text", "json"] = "text", stream: TextIO | None = None, clock: Callable[[], datetime] = now
    ) -> None:
        self.form = form
        self.lost = 0
        self.above: Callable[[str], bool] | None = None  # takes lines while a live table stands where they would go
        self._format = _as_json if form == "json" else _as_text
        self._stream = sys.stdout if stream is None else stream
        self._clock = clock
        self._gone = False
        self._descriptor = _descriptor(self._stream)

    def say(self, what: ServerEvent | str) -> None:
        """One line, at once."""
        self.put(self._format(what, self._clock()))

    def put(self, text: str, *, wait: bool = False) -> None:
        """Text as it stands, with what moves a cursor. wait: for whoever reads slowly."""
        if self.above is not None and self.above(text):
            return
        if self._gone or not self._put(text, wait):
            self.lost += 1

    def _put(self, line: str, wait: bool) -> bool:
        try:
            if self._descriptor is None:
                self._stream.write(line)
                self._stream.flush()
                return True
            if not wait and sys.platform != "win32" and not select.select([], [self._descriptor], [], 0.0)[1]:
                return False  # whoever reads does not: a terminal that is held, a pipe that is full
            data = line.encode("utf-8", "replace")
            while data:
                data = data[os.write(self._descriptor, data) :]
        except OSError as error:
            self._leave(error)
            return False
        except ValueError:  # a stream that was closed
            return False
        return True

    def _leave(self, error: OSError) -> None:
        """A closed pipe or terminal stays closed: what others print there must not fail either. A full disk may get room."""
        if self._descriptor is None or error.errno not in (errno.EPIPE, errno.EIO):
            return
        self._gone = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._descriptor)
        os.close(nowhere)


def _descriptor(stream: TextIO) -> int | None:
    """The file under a stream, past its buffers; None where there is none."""
    try:
        stream.flush()
        return stream.fileno()
    except (OSError, ValueError, AttributeError):
        return None


def _as_text(what: ServerEvent | str, at: datetime) -> str:
    """The words. What strangers name themselves may not move the cursor, or look like a line of ours."""
    return f"{shown((what if isinstance(what, str) else what.text)[:LONGEST_TEXT])}\n"


def _as_json(what: ServerEvent | str, at: datetime) -> str:
    """One object: time, level, event, text, and the fields that are set. ASCII."""
    if isinstance(what, str):
        what = ServerEvent(NOTICE, what)
        warns = what.text.startswith("warning:")
    else:
        warns = what.event in WARNINGS
    fields = {
        "time": at.isoformat(timespec="milliseconds"),
        "level": "warning" if warns else "info",
        "event": what.event,
        "text": what.text[:LONGEST_TEXT],
        **{name: value for name in FIELDS if (value := getattr(what, name))},
    }
    while (
        len(line := json.dumps(fields)) >= LONGEST_BYTES and fields["text"]
    ):  # characters beyond ASCII take six bytes and more
        fields["text"] = fields["text"][: len(fields["text"]) // 2]
    return f"{line}\n"
