"""The verdict on an arm before anyone holds it: measurements against its model. Pure; `io.arm_check` measures."""

from dataclasses import dataclass

LEAST_RATE_HZ = 1000.0
MOST_LATENCY_US = 900.0  # longest time to a reply: it must have come when the next tick of 1024 Hz reads it
MOST_MISSED = 0.001
MOST_NOISE_COUNTS = 1
LEAST_MOVED_COUNTS = 4  # least motion under the test current; less is friction, or nothing
JOINTS = "abc"


@dataclass(frozen=True, slots=True)
class ArmFindings:
    """Findings of `io.arm_check`; tuples have one number a joint, in counts.

    noise             highest less lowest at rest
    forward, backward how far a positive and a negative test current moved the joint
    lowest, highest   of all that was seen
    most_moved        the joint whose encoder the current of each joint moved most, 0 to 2
    """

    requests: int
    missed: int
    rate_hz: float
    latency_p50_us: float
    latency_p99_us: float
    noise: tuple[int, ...]
    forward: tuple[int, ...]
    backward: tuple[int, ...]
    lowest: tuple[int, ...]
    highest: tuple[int, ...]
    most_moved: tuple[int, ...] = (0, 1, 2)


@dataclass(frozen=True, slots=True)
class VerdictRow:
    """One line of the verdict. cure: what to do where it is not good."""

    what: str
    found: str
    wanted: str
    good: bool
    cure: str = ""


def verdict(measured: ArmFindings, current_ma: float) -> list[VerdictRow]:
    """Line by line."""
    rows = _wire(measured)
    for joint, name in enumerate(JOINTS):
        noise, low, high = measured.noise[joint], measured.lowest[joint], measured.highest[joint]
        cure = "let nobody touch the arm while it is measured; else check the encoder's cable and its supply"
        good, most = noise <= MOST_NOISE_COUNTS, f"at most {MOST_NOISE_COUNTS}"
        rows.append(VerdictRow(f"noise at rest, encoder {name}", f"{noise} counts", most, good, cure))
        moved = measured.most_moved[joint]
        swapped = moved != joint and joint in measured.most_moved  # else nothing moves this encoder: it is stuck
        other = JOINTS[moved] if swapped else name
        rows.append(_sign(name, measured.forward[joint], measured.backward[joint], current_ma, other))
        cure = "this encoder did not move: move the arm through its range when asked to, or check its cable"
        rows.append(
            VerdictRow(f"range seen, encoder {name}", f"{low} to {high}", "more than one count", high > low, cure)
        )
    return rows


def _wire(measured: ArmFindings) -> list[VerdictRow]:
    missed, p50, p99 = measured.missed / max(1, measured.requests), measured.latency_p50_us, measured.latency_p99_us
    return [
        VerdictRow(
            "requests answered",
            f"{100 * (1 - missed):.2f} %",
            f"at least {100 * (1 - MOST_MISSED):.1f} %",
            missed <= MOST_MISSED,
            "check the cable and the hub; close other programs that use the port",
        ),
        VerdictRow(
            "rate, one request after the other",
            f"{measured.rate_hz:.0f} Hz",
            f"at least {LEAST_RATE_HZ:.0f} Hz",
            measured.rate_hz >= LEAST_RATE_HZ,
            "use a port of its own, no hub; see `cogrip doctor`",
        ),
        VerdictRow(
            "latency, 50 and 99 %",
            f"{p50:.0f}, {p99:.0f} us",
            f"99 % within {MOST_LATENCY_US:.0f} us",
            p99 <= MOST_LATENCY_US,
            "see `cogrip doctor`; on Linux keep ModemManager off the port (docs/devices.md)",
        ),
    ]


def _sign(name: str, forward: int, backward: int, current_ma: float, other: str) -> VerdictRow:
    """Check the signs: a positive current raises the count of its own axis, whatever `dir` is, since both carry it."""
    what, found = f"sign, axis {name}", f"{forward:+d}, {backward:+d} counts"
    wanted = f"up, down under +-{current_ma:g} mA"
    if other != name:
        cure = f"the motor of axis {name} moves the encoder of axis {other} most: two motors or encoders are swapped"
        return VerdictRow(what, f"{found}, more at {other}", wanted, good=False, cure=cure)
    if forward >= LEAST_MOVED_COUNTS and backward <= -LEAST_MOVED_COUNTS:
        return VerdictRow(what, found, wanted, good=True)
    if forward <= -LEAST_MOVED_COUNTS and backward >= LEAST_MOVED_COUNTS:
        cure = f"motor or encoder of axis {name} is wired the other way round: force would push the wrong way; swap one"
    elif max(abs(forward), abs(backward)) < LEAST_MOVED_COUNTS:
        cure = "it did not move: is the amplifier enabled, the arm free, the motor plugged in?"
    else:
        cure = "it moved one way only: is it at a stop, or held? Try in mid-range"
    return VerdictRow(what, found, wanted, good=False, cure=cure)
