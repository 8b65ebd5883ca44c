"""Demands of a task on its wave line, where no linear model says more: scenes of rigid bodies, and worlds of one's own.

A line of loop time T and impedance b is a spring k = 2b/T and a mass m = bT/2 (theory 7.1). So a hand that presses with F is
F/k further than its tool, and on its line a tool swings with the period 2 pi sqrt(m/k) = pi T, whatever b is: a hand that
moves faster than that leaves it behind.
"""

from collections.abc import Iterator, Mapping
from math import pi

from cogrip.analysis.advice.advice import HEAVY_KG, carried_finding, gaps
from cogrip.analysis.advice.finding import Finding, Level, plain
from cogrip.client.safety.rendered_damper import damper_on
from cogrip.devices.for_user import address_of, make_for
from cogrip.devices.settings import parse_address
from cogrip.machine.addition import add_floats
from cogrip.protocol.settings.delays import line_delay
from cogrip.protocol.settings.line_tuning import filter_lag_s
from cogrip.protocol.settings.room import seat_axes, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings, User

LIGHT_GRIP_N = 3.0  # force with which a hand presses, where the settings' hand does not say
DEEP_M, OUT_OF_REACH_M = 0.01, 0.05
"""Depths of a hand beyond what it presses: a fingertip's breadth; half of a wrist's reach."""
SLOW = 0.5  # largest share of a stroke that a swing of the line may take


def hand_query(user: User) -> Mapping[str, str]:
    """Return the keys of a person's simulated hand; none for other people."""
    return dict(parse_address(f"sim:hand?hand={user.hand}").query) | dict(parse_address(address_of(user)).query)


def press_n(user: User) -> float:
    """Return the force with which a hand presses [N]."""
    query = hand_query(user)
    return abs(next((value for key in ("press_n", "force_n") if (value := _number(query.get(key)))), LIGHT_GRIP_N))


def stroke_s(user: User) -> float | None:
    """Return the shortest time in which a simulated hand moves from place to place, or once round; None for none."""
    query = hand_query(user)
    kind = query.get("hand", "")
    if kind in ("grasp", "reach"):
        return _number(query.get("stroke_s")) or {"grasp": 1.0, "reach": 0.8}[kind]
    if kind == "crank":
        return 2.0 * pi / abs(_number(query.get("speed_radps")) or 1.0)
    if kind == "sine":
        return 0.5 / (_number(query.get("frequency_hz")) or 1.0)
    if kind == "waypoints":
        times = [float(each) for each in query.get("times_s", "").split(",") if each]
        columns = [
            text.split(",") for key, text in query.items() if key != "times_s" and text.count(",") == len(times) - 1
        ]
        moves = [
            times[number] - times[number - 1]
            for number in range(1, len(times))
            if any(column[number] != column[number - 1] for column in columns)
        ]
        return min(moves, default=None)
    return None


def loop_s(seat: SeatSettings) -> float:
    """Return T: from a forward wave's own frame to that in which its answer is applied, and the filters' lag."""
    frames = add_floats(line_delay(seat.playout, link, seat.rates).frames for link in (seat.up, seat.down)) + 1.0
    return frames * seat.rates.frame_s + 2.0 * filter_lag_s(seat.line.wave_filter_hz)


def pressed(felt_npm: float, force_n: float) -> tuple[Level, str]:
    """Return how a stiffness stands to the force that a hand presses with, and the words for it."""
    depth_m = force_n / felt_npm
    level: Level = "ok" if depth_m <= DEEP_M else "note" if depth_m <= OUT_OF_REACH_M else "warning"
    return level, f"{plain(force_n, 3)} N go {plain(1e3 * depth_m, 2)} mm into it"


def free_tool(
    name: str, what: str, mass_kg: float, own_kg: float, loop_s: float, stroke_s: float | None, own: str = ""
) -> Finding:
    """Return the finding on what moves freely at a line's end: by its mass, and by the hand's own strokes.

    own: what own_kg is the mass of, if not of that itself
    """
    text = f"{name}: the free {what} feels like {plain(mass_kg, 3)} kg, {plain(own_kg, 2)} kg of it the {own or what}"
    level: Level = "note" if mass_kg - own_kg > HEAVY_KG else "ok"
    swing_s = pi * loop_s
    if stroke_s is not None and swing_s > SLOW * stroke_s:
        level = "warning" if swing_s > stroke_s else "note"
        text += (
            f"; it swings once in {plain(swing_s, 2)} s at its line, and the hand moves from place to place in "
            f"{plain(stroke_s, 2)} s: {'too fast for it' if level == 'warning' else 'it lags behind'}"
        )
    return Finding("free motion", text, level)


def own_world_findings(settings: Settings) -> Iterator[Finding]:
    """Yield what can be said of a world of one's own, whose program alone says how it moves. Raises DeviceError."""
    for number, user in enumerate(settings.users):
        seat, record = seat_settings(settings, number), make_for(user, seat_axes(settings, user)).capability
        yield carried_finding(settings, number, record)
        if not seat.coupling.traits.felt_through_waves:
            continue
        b, T = damper_on(seat, record).value_nspm, loop_s(seat)
        level, words = pressed(2.0 * b / T, press_n(user))
        text = f"{user.name}: the line is a spring of {plain(2.0 * b / T)} N/m at rest, in series with what is met: {words}"
        yield Finding("felt", text, level)
        device_kg = record.apparent_mass_kg
        yield free_tool(user.name, "hand", device_kg + 0.5 * b * T, device_kg, T, stroke_s(user), "device")
        yield from gaps(f"{user.name}: ", seat, b, record.continuous_force_n)
    yield Finding(
        "conditions",
        "a world of one's own has no linear model: whether it is stable and passive only sessions show, and which change "
        "would help is not looked for",
        "note",
    )


def _number(text: str | None) -> float | None:
    try:
        return float(text) if text is not None else None
    except ValueError:
        return None
