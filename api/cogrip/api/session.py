"""A live session: server and people as processes of this machine, or a server that runs already, with a callback."""

import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from cogrip.api import frames
from cogrip.api.administration import Administration
from cogrip.api.client import Client
from cogrip.api.errors import ApiError, as_api_error
from cogrip.api.runs import OnFrame, Run
from cogrip.api.settings import Source, settings
from cogrip.cli.runs.run_folder import new_run_folder
from cogrip.cli.session.children import end_all, how_ended, listening_at, start_child
from cogrip.cli.session.join_target import target_of
from cogrip.client.io.paths import JoinError, Paths
from cogrip.client.observer import ObserverCore
from cogrip.client.observer_loop import LiveObserver
from cogrip.devices.device import Device
from cogrip.machine.stop import Stop
from cogrip.protocol.wire.session import ClientSession
from cogrip.results.reading.folder import SETTINGS, client_log, write_settings
from cogrip.server.admission.roster import RosterEntry
from cogrip.server.events import ServerEvent

SERVER = "server"
WAIT_S = 0.02


class Session:
    """A server and its people, begun by `with` and ended with it; in between, callbacks, people of one's own, `wait`.

    Parameters
    ----------
    source, changes
        As of `settings`.
    mine
        Names of people who are left to the caller (`client`); the others are processes with the device of their settings.
    on_frame
        Called from a thread with each new view of the server, up to 64 a second. `Client` has one at the full frame rate.
    folder
        Folder below which the run's own is made.

    Raises ApiError where the server does not start. `address` is HOST:PORT, `folder` that of the run, `administration` the
    running server: `session.administration.set("anna", stiffness_npm=400)`.
    """

    def __init__(
        self, source: Source = "demo", *, mine: Collection[str] = (), on_frame: OnFrame | None = None,
        folder: str | Path = "runs", **changes: Any,
    ) -> None:  # fmt: skip
        self.settings = settings(source, **changes)
        self.address = ""
        names = [user.name for user in self.settings.users]
        if unknown := sorted(set(mine) - set(names)):
            raise ApiError(f"mine: {unknown[0]!r} is nobody of this session; there is: {', '.join(names)}")
        self._mine, self._on_frame, self._base = mine, on_frame, Path(folder)
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._threads: list[threading.Thread] = []
        self._clients: list[Client] = []
        self._failed: dict[str, str] = {}
        self._stop = Stop()
        self._state: tempfile.TemporaryDirectory[str] | None = None  # of the server

    def __enter__(self) -> Self:
        with as_api_error():
            self.folder = new_run_folder(self._base, self.settings.name)
            write_settings(self.folder, self.settings)
            file, log = str(self.folder / SETTINGS), self.folder / "server.log"
            seconds, into = str(self.settings.seconds), ["--into", str(self.folder)]
            # a socket's path has at most some hundred bytes, and that of a run may be longer
            state = self._state = tempfile.TemporaryDirectory(prefix="cogrip-")
            kept = ["--state", state.name]
            longest = str(self.settings.seconds + 60.0)  # it ends by itself if this process is killed
            self._children[SERVER] = start_child(
                log, ["serve", file, "--port", "0", *kept, "--seconds", longest, *into]
            )
            try:
                self.address = f"127.0.0.1:{listening_at(SERVER, self._children[SERVER], log, self._stop)}"
                self.administration = Administration(state.name)
                self.administration._seen = 0  # from the server's first event on
                if self._on_frame:
                    self._start(lambda: watch(self.address, self._on_frame, stop=self._stop))
                for user in self.settings.users:
                    if user.name not in self._mine:
                        who = ["--config", file, "--name", user.name, "--seconds", seconds]
                        log = self.folder / client_log(user.name)
                        self._children[user.name] = start_child(log, ["join", self.address, *who, *into])
            except BaseException:
                self._end()
                raise
        return self

    def client(self, name: str, device: Device, *, on_frame: OnFrame | None = None, trial: bool = True) -> Client:
        """Seat one of `mine` with a device of one's own, in a thread; return the client, which `stop` can end.

        trial: try its motors before, as `Client` says.
        """
        client = Client(
            self.address,
            device,
            name=name,
            seconds=self.settings.seconds,
            on_frame=on_frame,
            folder=self.folder,
            trial=trial,
        )
        self._clients.append(client)
        self._start(client.run, name)
        return client

    def set(self, name: str = "", /, **values: Any) -> str:
        """Change settings of a person, or of the room, while people hold the object: `Administration.set`."""
        return self.administration.set(name, **values)

    def mark(self, text: str) -> None:
        """Set a marker in every recording."""
        self.administration.mark(text)

    def who(self) -> Sequence[RosterEntry]:
        """Return everybody who is seated or observes."""
        return self.administration.who()

    def kick(self, name: str, reason: str = "") -> None:
        """End somebody's session."""
        self.administration.kick(name, reason)

    def wait_for(self, event: str, *, user: str = "", text: str = "", seconds: float | None = None) -> ServerEvent:
        """Return the next event of a kind: `Administration.wait_for`."""
        return self.administration.wait_for(event, user=user, text=text, seconds=seconds)

    def wait(self) -> Run:
        """Return the run once everybody has left. Raises ApiError with the reason where somebody's session broke off."""
        people = [child for name, child in self._children.items() if name != SERVER]
        while any(child.poll() is None for child in people) and self._children[SERVER].poll() is None:
            time.sleep(WAIT_S)
        self._end()
        if self._failed:
            raise ApiError("; ".join(f"{name}: {how}" for name, how in self._failed.items()))
        return Run(self.folder)

    def stop(self) -> None:
        """Ask everybody to leave; `wait` then returns the run."""
        for client in self._clients:
            client.stop()
        for name, child in self._children.items():
            if name != SERVER and child.poll() is None:
                child.send_signal(signal.SIGINT)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._children:
            self.stop()
            self._end()

    def _start(self, work: Callable[[], object], name: str = "") -> None:
        def run() -> None:
            try:
                work()
            except ApiError as error:
                self._failed[name or "watching"] = str(error)
            except Exception as error:  # of a callback of the caller's; the thread prints where
                self._failed[name or "watching"] = f"{type(error).__name__}: {error}"
                raise

        thread = threading.Thread(target=run, name=f"cogrip {name}".strip(), daemon=True)
        thread.start()
        self._threads.append(thread)

    def _end(self) -> None:
        """End the clients, then the server, then the watching thread."""
        for thread in self._threads:
            if thread.name != "cogrip":
                thread.join()
        for name in end_all(self._children, [SERVER]) if self._children else ():
            log = self.folder / ("server.log" if name == SERVER else client_log(name))
            self._failed.setdefault(name, how_ended(self._children[name], log))
        self._children.clear()
        if self._state is not None:
            self._state.cleanup()
        self._stop.reason = "the session is over"
        for thread in self._threads:
            thread.join()


def watch(target: str, on_frame: OnFrame | None, *, seconds: float | None = None, stop: Stop | None = None) -> None:
    """Observe a running session until it ends: `on_frame` gets each new view. Raises ApiError."""
    with as_api_error():
        aimed = target_of(target, "", False, "", "")
        paths = aimed.paths(insecure=False)
        try:
            _Watcher(paths, ClientSession(aimed.observer()), on_frame).run(stop or Stop(), seconds)
        finally:
            paths.close()


class _Watcher:
    """An observer that calls back once for each view."""

    def __init__(self, paths: Paths, session: ClientSession, on_frame: OnFrame | None) -> None:
        self._paths, self._core, self._on_frame = paths, ObserverCore(session), on_frame
        self._seen = 0
        self._begun_ns: int | None = None

    def run(self, stop: Stop, seconds: float | None) -> None:
        failed = LiveObserver(self._core, self._paths, stop, lambda text: None, self._show, seconds).run()
        if failed and not stop.reason:
            raise JoinError(failed)

    def _show(self, core: ObserverCore, now_ns: int) -> None:
        if core.views == self._seen or self._on_frame is None:
            return
        self._seen = core.views
        if self._begun_ns is None:
            self._begun_ns = now_ns
        if frame := frames.of_observer(core, (now_ns - self._begun_ns) * 1e-9):
            self._on_frame(frame)
