"""A player's process whose `web:` device a tab of the gateway moves: started with a token, ended with its tab."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress

from cogrip.machine.platform import system
from cogrip.view.io.hand_link import HandLink

KEPT_LINES = 50  # lines kept of what the process prints, for the reason of its end
MOST_LINE_BYTES = 4096
END_S = 3.0
OBSERVES = "this link is for observing"


class HandProcess:
    """One `cogrip join`. `start` waits until it has a seat; `ended` says why it has none any more.

    command    of the process, given the descriptor of its end of the link
    reason_of  tells why it ended by what it printed, "" where it gave no reason
    """

    def __init__(self, command: Callable[[int], Sequence[str]], reason_of: Callable[[Sequence[str]], str]) -> None:
        self._command, self._reason_of = command, reason_of
        self._lines: deque[str] = deque(maxlen=KEPT_LINES)
        self._known = asyncio.Event()  # whether it has got a seat
        self._reader: asyncio.Task[None] | None = None
        self._process: asyncio.subprocess.Process | None = None
        self.link: HandLink
        self.ended: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    async def start(self, target: str) -> bool:
        """Start the process, and return whether it has got a seat. target: its join link, which goes through a pipe."""
        ours, theirs = system.datagram_pair()
        self.link = HandLink(ours, self._known.set)
        with theirs:
            process = self._process = await asyncio.create_subprocess_exec(
                *self._command(theirs.fileno()), stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.STDOUT, limit=MOST_LINE_BYTES, **system.own_session(theirs.fileno()),
            )  # fmt: skip
        self.link.start()
        self._reader = asyncio.create_task(self._follow(process))
        assert process.stdin is not None
        with suppress(OSError):
            process.stdin.write(f"{target}\n".encode())
            await process.stdin.drain()
        await self._known.wait()
        return self.link.seat is not None and not self.ended.done()

    async def close(self) -> None:
        """End the process; it lets go and leaves its seat."""
        self.link.close()
        if self._process is None or self._reader is None:  # it was not even started
            return
        try:
            with suppress(ProcessLookupError):
                self._process.terminate()
            async with asyncio.timeout(END_S):
                await asyncio.shield(self._reader)
        except TimeoutError:
            with suppress(ProcessLookupError):
                self._process.kill()
            await self._reader

    async def _follow(self, process: asyncio.subprocess.Process) -> None:
        """Read what it prints until it ends."""
        stream = process.stdout
        assert stream is not None
        while True:
            try:
                line = await stream.readline()
            except ValueError:  # a longer one than is kept
                continue
            if not line:
                break
            text = line.decode(errors="replace").strip()
            self._lines.append(text)
            if OBSERVES in text:  # it observes, without a hand
                process.terminate()
                self._end(f"{OBSERVES}: ask for a player's link to hold the object")
        await process.wait()
        self._end(self._reason_of(self._lines) or "the hand's process ended")

    def _end(self, reason: str) -> None:
        if not self.ended.done():
            self.ended.set_result(reason)
        self._known.set()
