"""Log of a server on standard output: lines for people, or one JSON object a line for programs."""

import errno
import json
import os
import sys
from collections.abc import Callable
from datetime import datetime
from typing import Literal, TextIO

from cogrip.cli.terminal.platform import takes_output
from cogrip.protocol.texts import shown
from cogrip.server.events import ServerEvent

WARNINGS = ("lost", "kicked", "refused", "limited", "stiffness", "trouble")
"""Events that are warnings; the others are information."""
FIELDS = ("room", "user", "address", "code", "token")
LONGEST_BYTES = 4096  # most bytes of a line: a pipe takes so many whole or not at all
LONGEST_TEXT = 1000  # most characters of a text; only one that a peer controls is longer
NOTICE = "notice"  # event of a line that is said without one


def now() -> datetime:
    """Return the time, with the local offset from UTC."""
    return datetime.now().astimezone()


class LogLines:
    """Lines of events and texts. A reader that is gone, or does not read, never delays or ends the server.

    lost: count of lines without a reader. above: takes lines while a live table stands where they would go.
    """

    def __init__(
        self, form: Literal["text", "json"] = "text", stream: TextIO | None = None, clock: Callable[[], datetime] = now
    ) -> None:
        self.form = form
        self.lost = 0
        self.above: Callable[[str], bool] | None = None
        self._format = _as_json if form == "json" else _as_text
        self._stream = sys.stdout if stream is None else stream
        self._clock = clock
        self._gone = False
        self._descriptor = _descriptor(self._stream)

    def say(self, what: ServerEvent | str) -> None:
        """Write one line, at once."""
        self.put(self._format(what, self._clock()))

    def put(self, text: str, *, wait: bool = False) -> None:
        """Write a text unchanged, with its control characters. wait: for a slow reader."""
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
            if not wait and not takes_output(self._descriptor):
                return False  # a terminal on hold, or a full pipe
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
        """Replace a closed pipe or terminal, so that other prints do not fail either. A full disk may get room."""
        if self._descriptor is None or error.errno not in (errno.EPIPE, errno.EIO):
            return
        self._gone = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._descriptor)
        os.close(nowhere)


def _descriptor(stream: TextIO) -> int | None:
    """Return the file descriptor under a flushed stream; None where there is none."""
    try:
        stream.flush()
        return stream.fileno()
    except (OSError, ValueError, AttributeError):
        return None


def _as_text(what: ServerEvent | str, at: datetime) -> str:
    """Return the text, escaped: a peer's name must not move the cursor or imitate a line of the server."""
    return f"{shown((what if isinstance(what, str) else what.text)[:LONGEST_TEXT])}\n"


def _as_json(what: ServerEvent | str, at: datetime) -> str:
    """Return one object: time, level, event, text, and the fields that are set. ASCII."""
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
    while len(line := json.dumps(fields)) >= LONGEST_BYTES and fields["text"]:  # non-ASCII takes six bytes and more
        fields["text"] = fields["text"][: len(fields["text"]) // 2]
    return f"{line}\n"
