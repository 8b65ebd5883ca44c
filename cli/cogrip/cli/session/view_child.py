"""The view beside another command: a process of its own, which shows that command's session in the browser."""

import json
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from cogrip.cli.session.front_ends import front_ends
from cogrip.cli.terminal.problem import BadInput, Problem, within
from cogrip.devices.family.web import NAMES
from cogrip.machine.platform import system

END_LIMIT_S = 3.0
GONE = "the page's process has ended; the session goes on without it"
GONE_HAND = "the page's process has ended, and the hand has let go: leave with Ctrl-C, and join again for a new page"
SCHEME = "web"


@dataclass(frozen=True, slots=True)
class PageOptions:
    """Options of `cogrip view` that a command with a page takes as well."""

    browser: bool = True
    port: int = 0
    foxglove: bool = False
    foxglove_origin: tuple[str, ...] = ()

    def check(self, *, shown: bool) -> None:
        """Raise BadInput for what is no option of a page, and for one where no page is shown."""
        within("--port", self.port, 0, 65535)
        front_ends(self.foxglove, self.foxglove_origin)
        if not shown and (self.port or self.foxglove):
            raise BadInput(
                f"{'--port' if self.port else '--foxglove'} is of a page: give --view or --device web as well; the port of a"
                " server stands behind its host, HOST:PORT"
            )

    def flags(self) -> list[str]:
        """Return them as the command line has them."""
        words = [*([] if self.browser else ["--no-browser"]), *(["--port", str(self.port)] if self.port else [])]
        words += ["--foxglove"] if self.foxglove else []
        return words + [word for origin in self.foxglove_origin for word in ("--foxglove-origin", origin)]


class ViewChild:
    """Process of `cogrip view`, ended with the context. hand: give it a link to a `web:` device, whose end is `fd`."""

    def __init__(
        self,
        target: str,
        say: Callable[[str], None],
        room: str = "",
        insecure: bool = False,
        *,
        hand: bool = False,
        waits: bool = True,
        page: PageOptions = PageOptions(),
    ) -> None:
        """target: join link or HOST:PORT; it goes through a pipe, where no other user sees it. Raises Problem."""
        self._closing = False
        self._ours: socket.socket | None = None
        theirs: socket.socket | None = None
        arguments = ["view", "-", *(("--room", room) if room else ()), *(("--insecure",) if insecure else ())]
        arguments += page.flags()
        if hand:
            self._ours, theirs = system.message_pair()
            arguments += ["--hand", str(theirs.fileno())]
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", "cogrip.cli", *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, encoding="utf-8", errors="replace",
            **system.own_session(*([theirs.fileno()] if theirs else [])),
        )  # fmt: skip
        if theirs is not None:
            theirs.close()
        assert self._child.stdin is not None
        with suppress(OSError), self._child.stdin as pipe:
            pipe.write(target + "\n")
        if waits:
            self._begin(say)
        else:
            threading.Thread(target=self._pass_on, args=[say], daemon=True).start()

    def _begin(self, say: Callable[[str], None]) -> None:
        """Pass on what it says up to its address. Raises Problem where it ends before that."""
        assert self._child.stdout is not None
        said = ""
        for line in self._child.stdout:
            said = line.strip().removeprefix("cogrip: ")
            if said.startswith("view: "):
                say(said)
                threading.Thread(target=self._watch, args=[say], daemon=True).start()
                return
        self.close()
        raise Problem(f"the view did not start: {said or 'it gave no reason'}")

    def _watch(self, say: Callable[[str], None]) -> None:
        """Pass on what it says further, and that it has ended, in a thread that waits for it."""
        self._pass_on(say)
        if not self._closing:
            say(GONE_HAND if self._ours is not None else GONE)

    def _pass_on(self, say: Callable[[str], None]) -> None:
        """Pass on all that it says, in a thread that waits for it."""
        assert self._child.stdout is not None
        with suppress(ValueError):  # closed meanwhile
            for line in self._child.stdout:
                say(line.strip().removeprefix("cogrip: "))

    def linked(self, device: str | None) -> str | None:
        """Return the address of a device, with the link in it where it is the pointer. Raises BadInput for an unknown one."""
        if self._ours is None or device is None:
            return device
        return linked_device(device, self._ours.fileno())

    def seated(self, seat: int) -> None:
        """Tell the page which seat its hand has."""
        if self._ours is not None:
            with suppress(OSError):
                self._ours.send(json.dumps({"seat": seat}).encode())

    def close(self) -> None:
        """End the process."""
        self._closing = True
        if self._child.poll() is None:
            system.end(self._child)
            try:
                self._child.wait(END_LIMIT_S)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()
        if self._child.stdout is not None:
            self._child.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class GivenLink:
    """Link to a page of another process, which started this one with its descriptor in the device's address."""

    def __init__(self, fd: int) -> None:
        self._fd = fd

    def seated(self, seat: int) -> None:
        """Tell the page which seat its hand has."""
        with suppress(OSError):
            end = socket.socket(fileno=self._fd)
            try:
                end.send(json.dumps({"seat": seat}).encode())
            finally:
                end.detach()  # it is the device's


def given_link(device: str | None) -> GivenLink | None:
    """Return the link that stands in a device's address, None where there is none."""
    found = re.match(rf"{SCHEME}:pointer\?(?:.*&)?fd=(\d+)", device or "")
    return GivenLink(int(found[1])) if found else None


def linked_device(device: str, fd: int) -> str:
    """Return the address of a pointer with its link in it. Raises BadInput for another web device."""
    name, _, query = device.removeprefix(SCHEME).removeprefix(":").partition("?")
    if name not in ("", "pointer"):
        raise BadInput(f"--device {device!r}: no such web device; there is: {', '.join(NAMES)}")
    return f"{SCHEME}:pointer?{f'{query}&' if query else ''}fd={fd}"


def is_web(device: str | None) -> bool:
    """Return whether a device address asks for the pointer of a page that this command is to serve."""
    if device is None or given_link(device):
        return False
    return (device == SCHEME or device.startswith(f"{SCHEME}:")) and "idle" not in device


def open_view(
    stack: ExitStack,
    target: str,
    say: Callable[[str], None],
    room: str,
    insecure: bool,
    *,
    wanted: bool,
    hand: bool = False,
    page: PageOptions = PageOptions(),
) -> ViewChild | None:
    """Open the page of a session where it is wanted, or a hand is its pointer; closed with `stack`. Raises Problem."""
    if not (wanted or hand):
        return None
    return stack.enter_context(ViewChild(target, say, room, insecure, hand=hand, page=page))
