"""`cogrip devices emulate`: an emulated device on a pseudo-terminal or a socket, with faults on request."""

import os
import stat
import sys
import tempfile
from pathlib import Path
from typing import Literal

from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem, within
from cogrip.devices.device import DeviceError
from cogrip.devices.family.machines import MACHINES, make_firmware
from cogrip.devices.io.platform import PSEUDO_TERMINALS, SEQUENCED
from cogrip.devices.io.pseudo_terminal import PseudoTerminal
from cogrip.devices.io.report_socket import ReportSocket, is_socket
from cogrip.devices.io.served_firmware import ServedFirmware
from cogrip.devices.io.service_socket import ServiceSocket
from cogrip.devices.settings import parse_address
from cogrip.machine.realtime import engage, release
from cogrip.machine.stop import Stop, on_signals

_DEFAULTS = {"serial": "vintage", "haply": "2diy", "hid": "woodenhaptics", "inverse": "inverse3"}


def device_emulate(
    kind: Literal["serial", "haply", "hid", "inverse"],
    /,
    *,
    model: str = "",
    hand: str = "reach",
    powered_at_m: tuple[float, float, float] | None = None,
    seed: int = 1,
    link: Path | None = None,
    port: int = 0,
    fast: bool = True,
) -> int:
    """Serve an emulated device on a pseudo-terminal or a socket.

    It behaves as the device's firmware, with the arm's mechanics and a hand behind it, until Ctrl-C. Lines on its input are
    verbs: silence, garbage, split, merge, short, slow, stale, model, jump, stuck, unplug, deaf, reversed, each with its seconds
    (`silence 0.3`; for ever without); mend; press (the calibrate button); status; quit.

    Parameters
    ----------
    kind
        The wire: serial (hfab) or haply, on a pseudo-terminal; hid, on a local socket, which `hid:` takes as its path; or
        inverse, Haply's service with its websocket on loopback.
    model
        The machine; vintage, 2diy, woodenhaptics or inverse3 if not given.
    hand
        The hand that holds it, with its keys and those of sim:phantom: 'reach&amplitude_m=0.02&x0_m=0,0,0.01'.
    powered_at_m
        Position of the tip when the arm was powered up: X Y Z; in its home pose if not given.
    seed
        Seed of garbage.
    link
        Make a symbolic link of this name to the pseudo-terminal, also when it changes; hid: the name of the socket.
    port
        Of inverse: the port of the websocket, any free one if not given.
    fast
        Ask the system for real-time scheduling.
    """
    name = model or _DEFAULTS[kind]
    machines = {known.removesuffix("-hid"): known for known, machine in MACHINES.items() if machine.scheme == kind}
    known = list(machines)
    if name not in known:
        raise BadInput(f"--model {name!r}: {kind} has {', '.join(known) or 'none'}")
    _check_system(kind, name)
    if (kind == "inverse" and link is not None) or (kind != "inverse" and port):
        raise BadInput(f"--{'link' if link else 'port'}: {kind} has none; {'use --port' if link else 'use --link'}")
    if kind == "inverse" and powered_at_m is not None:
        raise BadInput("--powered-at-m: inverse knows its pose wherever it is powered up; leave it out")
    within("--port", port, 0, 65535)
    if link is not None and link.exists() and not (is_socket(str(link)) if kind == "hid" else link.is_symlink()):
        what = "socket" if kind == "hid" else "link"
        raise BadInput(f"--link {link}: is there already and no {what}; name another one, it would be replaced")
    console = make_console(soft_wrap=True)
    with BadInput.of(DeviceError):
        firmware = make_firmware(machines[name], parse_address(f"sim:phantom?hand={hand}").query, seed, powered_at_m)

    wire: ServedFirmware
    folder = ""
    if kind == "inverse":
        wire, keys = ServiceSocket(firmware, port, console.print), ""
    elif kind == "hid":
        folder = tempfile.mkdtemp(prefix="cogrip-") if link is None else ""
        wire = ReportSocket(firmware, link or Path(folder) / "hid", console.print)
        keys = "&pose=home"
    else:
        wire = PseudoTerminal(firmware, link, console.print)
        keys = "?pose=home" if kind == "serial" else f"?model={name}&pose=home"  # a Haply board does not say what it is
    pose = f"its counters are zero in the home pose: join it with {keys}"
    if powered_at_m is not None:
        pose = "it was powered up elsewhere than in its home pose, so its pose is not known"
    if kind == "inverse":
        pose = "it knows its pose"
    stop = Stop()
    with on_signals(stop):
        try:
            wire.plug()
        except OSError as error:
            where = f"--link {link}: cannot be made: " if link is not None else "no pseudo-terminal or socket: "
            where = f"--port {port}: " if port else where
            raise Problem(f"{where}{error.strerror or error}; name another place") from None
        measures = engage(["gc-frozen", "fifo"]) if fast else []
        try:
            address = f"hid:{name}?path={wire.where}" if kind == "hid" else f"{kind}:{wire.where}"
            console.print(f"{name} behind {address}; {pose}")
            wire.run(_verbs(), lambda: bool(stop.reason))
        finally:
            release(measures)
            if folder:
                Path(folder).rmdir()
    return 0


def _verbs() -> int | None:
    """Return the file descriptor of a terminal or pipe on standard input, None for others."""
    try:
        descriptor = sys.stdin.fileno()
        return descriptor if os.isatty(descriptor) or stat.S_ISFIFO(os.fstat(descriptor).st_mode) else None
    except (AttributeError, OSError, ValueError):
        return None


def _check_system(kind: str, name: str) -> None:
    """Raise BadInput for a wire that this system does not have."""
    if kind in ("serial", "haply") and not PSEUDO_TERMINALS:
        raise BadInput(
            f"{kind}: needs pseudo-terminals, which this system has not; use `emulated:{name}` as the device"
        )
    if kind == "hid" and not SEQUENCED:
        raise BadInput("hid: needs local sockets that keep messages apart, which this system has not; use `emulated:`")
