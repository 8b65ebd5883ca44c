"""`cogrip devices list`: the devices that have an address, with their records."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Annotated, Any

import msgspec
from cyclopts import Parameter
from rich.console import Console
from rich.text import Text

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput, within
from cogrip.cli.terminal.tables import say
from cogrip.devices.device import Capability, DeviceError
from cogrip.devices.registry import (
    FAMILIES,
    Listing,
    axes_of,
    broken,
    describe,
    families,
    is_input_only,
    is_real,
    make,
    record_of,
)  # fmt: skip
from cogrip.devices.settings import MOST_AXES, parse_address
from cogrip.machine.addition import add_integers
from cogrip.protocol.axes import GRIP_AXES, POSE_AXES

NOT_RUN = "not run on hardware"
INPUT_ONLY = "input only: no force"
_NO_HARDWARE = ("web",)  # families in real time without hardware
_LAST = ("emulated", "replay")  # families that stand last in a list, behind real devices; sim: stands first
_HEADINGS = (("address", "axes", "peak", "stiffness", "damping", "rate"), ("", "", "N", "N/m", "N s/m", "Hz"))


def device_list(
    name: str = "",
    /,
    *,
    verbose: Annotated[bool, Parameter(negative="")] = False,
    axes: int = MOST_AXES,
    json: Json = None,
) -> int:
    """List the devices that have an address, with their records.

    A line each, or the whole capability record of some.

    Parameters
    ----------
    name
        Show the whole records of these: an address, a family such as sim, or a part of an address such as omega.
    verbose
        Show the whole record of every device.
    axes
        Count of axes to make them with, 1 to 3.
    """
    within("--axes", axes, 1, MOST_AXES)
    with BadInput.of(DeviceError):
        listings, summaries = describe(axes=axes), families()
        listings = _named(name, listings, axes) if name else listings
    if json is not None:
        write_json(_as_json(listings, summaries), json)
        return 0
    console = make_console()
    cells = {each.address: _cells(each) for each in listings}
    widths = _widths(cells.values(), console.width)
    if not (name or verbose):
        console.print(_lines(_HEADINGS, widths, "dim"), soft_wrap=True)
    for scheme in sorted(summaries, key=_rank):
        found = [each for each in listings if _scheme(each) == scheme]
        if name and not found:
            continue
        marks = [INPUT_ONLY] * is_input_only(f"{scheme}:") + [NOT_RUN] * _untried(scheme)
        mark = f" ({'; '.join(marks)})" if marks else ""
        say(console, f"{scheme}: {summaries[scheme]}{mark}")
        if name or verbose:
            for listing in found:
                _print_record(listing, console)
        elif found:
            console.print(_lines([cells[each.address] for each in found], widths), soft_wrap=True)
    for text in broken().values():
        say(console, f"left out: {text}")
    if not (name or verbose):
        say(console, "`cogrip devices list NAME` shows whole records, --verbose those of all; `--json -` as they are.")
    return 0


def _named(name: str, listings: Sequence[Listing], axes: int) -> tuple[Listing, ...]:
    """Return those whose address is `name`, else of that family, else with that in their address; else the one at `name`.

    Raises DeviceError where there is none.
    """
    for fits in (
        lambda each: each.address == name,
        lambda each: _scheme(each) == name.removesuffix(":"),
        lambda each: name in each.address,
    ):
        if found := tuple(filter(fits, listings)):
            return found
    if ":" not in name:
        raise DeviceError(f"devices: no address has {name!r} in it; `cogrip devices list` shows them all")
    return (Listing(name, "", record_of(make(name, axes=min(axes, axes_of(name))), name)),)


def _scheme(listing: Listing) -> str:
    return parse_address(listing.address).scheme


def _rank(scheme: str) -> tuple[int, str]:
    """Return the place of a family in the list: sim first, then hardware by name, then its substitutes."""
    return (0 if scheme == "sim" else 2 + _LAST.index(scheme) if scheme in _LAST else 1), scheme


def _untried(scheme: str) -> bool:
    """Return whether the family is our driver of hardware; of other packages' drivers nothing is known."""
    return scheme in FAMILIES and scheme not in _NO_HARDWARE and is_real(f"{scheme}:")


def _widths(rows: Iterable[Sequence[str]], width: int) -> list[int]:
    """Return widths of the columns, for all tables below one heading; addresses are wrapped where there is no room."""
    first, *numbers = [max(map(len, column)) for column in zip(*_HEADINGS, *rows, strict=True)]
    return [max(1, min(first, width - add_integers(numbers) - len(numbers))), *numbers]


def _lines(rows: Sequence[Sequence[str]], widths: Sequence[int], style: str = "") -> Text:
    """Return a line a device, or the heading of all; an address that is wider than its column goes on below."""
    first, *others = widths
    lines = []
    for address, *numbers in rows:
        begin, *rest = [address[place : place + first] for place in range(0, len(address), first)] or [""]
        lines.append(" ".join([begin.ljust(first), *map(str.rjust, numbers, others)]))
        lines += rest
    return Text("\n".join(lines), style)


def _cells(listing: Listing) -> tuple[str, ...]:
    """Return the cells below _HEADINGS."""
    record = listing.capability
    peak = "none" if is_input_only(listing.address) else f"{record.peak_force_n:.4g}"
    return (
        listing.address, _axes(listing), peak, f"{record.stiffness_npm:.5g}", f"{record.damping_nspm:.4g}",
        f"{record.rate_hz}",
    )  # fmt: skip


def _axes(listing: Listing) -> str:
    """Return the axes that were asked for, and those of a device that has a gripper with force, or turns."""
    axes = [listing.capability.axes]
    for more in (GRIP_AXES, POSE_AXES):
        with suppress(DeviceError):
            make(listing.address, axes=more)
            axes.append(more)
    return "/".join(map(str, axes)) if len(axes) < 3 else f"{axes[0]}-{axes[-1]}"  # in the width of a column


def _print_record(listing: Listing, console: Console) -> None:
    """Print the whole record, a line a subject."""
    record = listing.capability
    own = [
        *([f"damping {_number(record.own_damping_nspm, 'N s/m')}"] if record.own_damping_nspm else []),
        *([f"friction {_number(record.own_friction_n, 'N')}"] if record.own_friction_n else []),
    ]
    subjects = {
        "is": f"{record.family}, {record.model}",
        "axes": f"{_axes(listing)}, workspace {'; '.join(_workspace(record))}",
        "force": f"{'on a simulated mass, none reaches the hand: ' if is_input_only(listing.address) else ''}"
        f"peak {_number(record.peak_force_n, 'N')}, continuous {_number(record.continuous_force_n, 'N')}, "
        f"slope {_number(record.slew_nps, 'N/s')}",
        "advised": f"stiffness {_number(record.stiffness_npm, 'N/m')}, damping {_number(record.damping_nspm, 'N s/m')}",
        "position": f"one count {_number(record.resolution_m * 1e3, 'mm') if record.resolution_m else 'exact'}, "
        f"sample {record.latency_ticks} ticks old",
        "speed": f"at most {_number(record.speed_mps, 'm/s')}, {'given' if record.gives_velocity else 'estimated'}",
        "felt mass": _number(record.apparent_mass_kg, "kg"),
        "own losses": ", ".join(own) or "not known",
        "rate": f"at most {_number(record.rate_hz, 'Hz')}",
        "handle": ", ".join(handle_words(record)) or "no buttons, orientation or gripper",
    }
    say(console, f"  {listing.address}")
    for subject, words in subjects.items():
        say(console, f"    {subject:11}{words}", " " * 15)


def handle_words(record: Capability) -> list[str]:
    """Return a text for each thing that the device gives beside its axes."""
    return [
        *([f"{record.buttons} button{'s' if record.buttons > 1 else ''}"] if record.buttons else []),
        *(["orientation"] if record.gives_orientation else []),
        *([f"gripper {record.grip_m[0] * 1e3:g} to {record.grip_m[1] * 1e3:g} mm"] if record.grip_m else []),
    ]


def _workspace(record: Capability) -> Sequence[str]:
    """Return a text an axis, or one if all are the same."""
    texts = [
        f"±{high * 1e3:g} mm" if high == -low else f"{low * 1e3:g} to {high * 1e3:g} mm"
        for low, high in record.workspace_m
    ]
    return texts[:1] if len(set(texts)) == 1 else texts


def _number(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}"


def _as_json(listings: Sequence[Listing], summaries: dict[str, str]) -> dict[str, Any]:
    """Return the records, field by field."""
    return {
        "families": {
            scheme: {
                "summary": summary,
                "real": is_real(f"{scheme}:"),
                "input_only": is_input_only(f"{scheme}:"),
                "not_run_on_hardware": _untried(scheme),
            }
            for scheme, summary in summaries.items()
        },
        "devices": [
            {"address": listing.address, "real": is_real(listing.address), **msgspec.to_builtins(listing.capability)}
            for listing in listings
        ],
    }
