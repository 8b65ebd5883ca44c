"""Recorded hands with other settings: a laboratory session of a recorded run's settings with some of them changed.

How the recorded people take part:

    same        the same simulated hand and device as in the settings: it makes the same effort and gives way to new forces
    impedance   what the recorded hand must have exerted, m x'' + B_h x' + K_h x + F, behind its impedance (`ReconstructedHand`)
    positions   the recorded device positions, whatever the force
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec

from cogrip.client.recorder import start_of
from cogrip.client.safety.rendered_damper import refusal
from cogrip.devices.device import Capability
from cogrip.devices.for_user import address_of
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.settings.room import rates_of, resolve, seat_settings
from cogrip.protocol.settings.sections import Settings, User
from cogrip.protocol.texts import clipped
from cogrip.protocol.wire.messages import DEVICE_BYTES, Hello
from cogrip.results.reading.records import End, RunRecords

Hands = Literal["same", "impedance", "positions"]


@dataclass(frozen=True, slots=True)
class WhatIf:
    """Settings that a laboratory is to run, and with which tick of the session, at their own rate, each person begins.

    overloads: people whose recorded devices would be asked for more than they carry, though others stand in for them.
    """

    settings: Settings
    begins: tuple[int, ...]
    overloads: tuple[str, ...] = ()


def what_if(run: RunRecords, changes: Mapping[str, Any], hands: Hands = "same") -> WhatIf:
    """A laboratory session with the hands of `run`; `changes` as `--set` gives them. People begin when they began.

    hands: `same` takes simulated hands as they were and all others through an impedance.
    Raises RecordingError where the server's part or a person's is missing, SettingsError for changes that do not fit.
    """
    recorded = run.settings()
    if recorded is None:
        raise RecordingError(
            f"{run.folder} holds no recording of the server, so its settings are not known; "
            "name the server's run folder, or join both with `cogrip merge`"
        )
    table = msgspec.to_builtins(recorded)
    records = []
    for user, row in zip(recorded.users, table["users"], strict=True):
        hello, record = _start(run, user)
        row.update(_hand(run, user, hands, hello, record))
        records.append(record)
    spans = [_span(run.clients[user.name]) for user in recorded.users]
    first_s = min(start_s for start_s, _ in spans)
    seconds, network_hz = max(end_s for _, end_s in spans) - first_s, recorded.rates.network_hz
    if round(seconds * network_hz) != round(recorded.seconds * network_hz):  # else it ran as long as it should
        table["seconds"] = seconds
    settings = resolve(table, changes)
    begins = [
        round((start_s - first_s) * settings.rates.network_hz) * rates_of(settings, user).ticks_per_frame
        for user, (start_s, _) in zip(settings.users, spans, strict=True)
    ]
    overloads = [
        refusal(seat_settings(settings, number), record)
        for number, (before, after, record) in enumerate(zip(table["users"], settings.users, records, strict=True))
        if before["device"] == after.device  # nobody was given another one
    ]
    return WhatIf(settings, tuple(begins), tuple(text for text in overloads if text))


def _start(run: RunRecords, user: User) -> tuple[Hello, Capability]:
    """Return what a recorded person asked the server for, and the record of their device."""
    end = run.clients.get(user.name)
    if end is None:
        there = ", ".join(run.clients) or "nobody"
        raise RecordingError(f"{run.folder} holds no recording of {user.name!r}; there is: {there}")
    try:
        return start_of(end.recording.header.start)
    except (KeyError, ValueError) as error:
        raise RecordingError(f"{end.path} does not say what device was recorded: {error}") from None


def _hand(run: RunRecords, user: User, hands: Hands, hello: Hello, capability: Capability) -> dict[str, str | float]:
    """Return the keys of a user that bring the recorded person back."""
    end = run.clients[user.name]
    source = f"{run.folder if run.folder.is_dir() else end.path}#user={user.name}"
    if hands == "positions":
        return {"device": f"replay:{source}"}
    asked, said = address_of(user), hello.device
    whole = asked if said == clipped(asked, DEVICE_BYTES) else said
    cut = len(said.encode()) > DEVICE_BYTES - 4  # a character has up to four bytes
    known = whole != said or not cut
    mass = {"device_mass_kg": capability.apparent_mass_kg}
    if hands == "same" and hello.device.startswith("sim:") and known:
        return {} if whole == address_of(user) else {"device": whole, **mass}
    machine = "phantom" if capability.model == "phantom" else "ideal"
    impedance = _impedance(whole if known else address_of(user))
    return {"device": f"sim:{machine}", "hand": f"recording:{source}{impedance}", **mass}


def _impedance(address: str) -> str:
    """Return the impedance keys of a simulated hand's address, for another hand."""
    items = address.partition("?")[2].split("&")
    return "".join(f"&{item}" for item in items if item.startswith(("hand_stiffness_npm=", "hand_damping_nspm=")))


def _span(end: End) -> tuple[float, float]:
    """Return the start of a client's first tick and the end of its last one [s], on the run's clock."""
    start_s, last = None, -1
    for times, ticks in end.chunks("tick"):
        start_s = times[0] if start_s is None else start_s
        last = ticks[-1].tick
    if start_s is None:
        raise RecordingError(f"{end.path} holds no ticks; there is no hand to run again")
    return start_s, start_s + (last + 1) / end.rate_hz


def label(changes: Mapping[str, Any]) -> str:
    """Return the changes as a heading."""
    return ", ".join(f"{key} = {value}" for key, value in changes.items()) or "unchanged"


def folder_name(run: RunRecords) -> str:
    """Return the name of the new run."""
    settings = run.settings()
    return f"{settings.name if settings else Path(run.folder).name}-what-if"
