"""`rates.network_hz = "auto"` where a session is started: by what a frame takes on this machine, or by what is stated."""

from collections.abc import Callable
from pathlib import Path

import msgspec
from msgspec.structs import replace

from cogrip.machine.platform import time
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.network_rate import OUTSIDE_S, RATES_HZ, RateChoice, stated_frame_s
from cogrip.protocol.settings.room import best_network_hz, for_remote_clients
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import write_whole
from cogrip.server.checkpoint import CheckpointError, decode
from cogrip.server.io import checkpoint_file
from cogrip.server.io.state_folder import StateError, StateFolder

FILE = "network_rate.json"
Choose = Callable[[Settings], RateChoice]


def stated(settings: Settings) -> RateChoice:
    """Choose by settings alone: the same everywhere."""
    return RateChoice(best_network_hz(settings), "stated", stated_frame_s(settings))


def measured(settings: Settings) -> RateChoice:
    """Choose by the time that the room's frame takes here, at the rate that devices and link would have."""
    from cogrip.sim.frame_cost import frame_cost

    fastest = replace(settings, rates=replace(settings.rates, network_hz=best_network_hz(settings, 0.0)))
    cost = frame_cost(fastest, time.monotonic_ns, _wait_until)
    frame_s = cost.frame_s + OUTSIDE_S * len(settings.users)
    return RateChoice(best_network_hz(settings, frame_s), "measured", frame_s, cost.frames)


def _wait_until(due_ns: int) -> None:
    time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)


def kept(settings: Settings, folder: Path | None) -> RateChoice | None:
    """Return the rate of the room's checkpoint in this folder; None where there is none that fits."""
    if folder is None:
        return None
    try:
        data = checkpoint_file.read(StateFolder(folder).checkpoint(settings.name))
        found = decode(data).digest if data else None
    except (StateError, CheckpointError):
        return None  # whoever restores it says what is wrong
    for hz in RATES_HZ:
        tried = replace(settings, rates=replace(settings.rates, network_hz=hz))
        if found in (digest(tried), digest(for_remote_clients(tried))):
            return RateChoice(hz, "kept")
    return None


class RateChoices:
    """Choices for the rooms that ask for "auto", by name, kept to be said and written. A function of settings, for `load`."""

    def __init__(self, choose: Choose, folder: Path | None = None) -> None:
        """folder: of the server's state, where a checkpoint of another rate would be of no use; None: there is none."""
        self._choose, self._folder = choose, folder
        self.found: dict[str, RateChoice] = {}

    def __call__(self, settings: Settings) -> int:
        choice = self.found[settings.name] = kept(settings, self._folder) or self._choose(settings)
        return choice.network_hz

    def lines(self) -> list[str]:
        """Return what was chosen, a line for each room."""
        return [f"room {name}: {choice.text}" for name, choice in self.found.items()]


def write_choice(folder: Path, choice: RateChoice | None) -> None:
    """Leave a choice and its measurement in a run folder, where there is one."""
    if choice is not None:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / FILE, msgspec.json.format(msgspec.json.encode(choice), indent=2) + b"\n")
