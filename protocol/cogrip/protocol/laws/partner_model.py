"""Model of a partner's hand about its intention, and one step of an object that several hold (theory 5b); both ends use it.

Symbols, per axis: o object, x_j device of partner j, e_j its intention, k_j its hand's stiffness, m_d, b_m mass and damping of
the model, K, B the spring of a seat, T step. Implicit Euler, copy and models together:

    f_j = K (x_j - o) + B (x_j' - o')       m_o o'' = sum_j f_j - d o'
    m_d x_j'' = k_j (e_j - x_j) - b_m x_j' + DRIFTING b_a u_j - f_j

b_a is the part of b_m that a model has for being late, u_j the rate of e_j through one pole of DRIFT_S: a hand that goes on
evenly does not drag its partners by all of a damping that only keeps a loop below 1.
"""

from collections.abc import Sequence

from cogrip.protocol.laws.poses import IN_PLACES, Places

MODEL_KG = 0.1  # m_d, mass of the device in a model
HAND_NSPM = 5.0  # b_e, damping of a hand in the estimate of its intention
ADDED_NSPM = 10.0  # damping b_m - b_e that a late model has more; it keeps the loop of two clients below 1
MODEL_NSPM = HAND_NSPM + ADDED_NSPM  # b_m of a model that is late
DRIFTING = 0.5  # part of the added damping that acts against the drift of an intention, and not against rest
DRIFT_S = 0.1  # time constant of that drift
LATE_S = 0.04  # age of an intention from which its model has all of the added damping
DAMPED_NPM = 150.0  # least stiffness of a hand whose model has all of b_m
HORIZON_S = 0.1  # h, the longest time for which an intention is taken to go on


class Model:
    """One partner's hand on all axes: where its device is taken to be, and how fast. drift_mps: u of its intention.

    space: of its rows, which are places or poses
    """

    __slots__ = ("age_s", "drift_mps", "intention_m", "place_m", "space", "stiffness_npm", "velocity_mps")

    def __init__(self, place_m: Sequence[float], space: Places = IN_PLACES) -> None:
        self.space = space
        self.place_m = list(place_m)
        self.velocity_mps = [0.0] * len(self.place_m)
        self.intention_m = list(place_m)
        self.drift_mps = [0.0] * len(self.place_m)
        self.stiffness_npm = 0.0
        self.age_s = LATE_S  # of the intention

    @property
    def added_nspm(self) -> float:
        """b_a: less for a hand that hardly holds, none where it has let go."""
        return ADDED_NSPM * min(1.0, self.age_s / LATE_S) * min(1.0, self.stiffness_npm / DAMPED_NPM)

    @property
    def damping_nspm(self) -> float:
        """b_m."""
        return HAND_NSPM * min(1.0, self.stiffness_npm / DAMPED_NPM) + self.added_nspm

    def follow(self, rate_mps: Sequence[float], passed_s: float) -> None:
        """Let the drift follow the rate of the intention for a time."""
        pole = min(1.0, passed_s / DRIFT_S)
        self.drift_mps = [drift + pole * (rate - drift) for drift, rate in zip(self.drift_mps, rate_mps, strict=True)]


class ToolDrive:
    """Hold of a model on a tool of a scene through the spring of its seat, for one step of that scene (theory 5b.3).

    The tool is what the spring holds in place of o, and whoever steps it knows its velocity q' after the step only: of

        f = K (x - q) + B (x' - q')        at the step's end, implicit Euler as in `step_object`

    the part that does not depend on q' is a force, the rest a damper of the tool to ground.

    force_n       of it, on all axes
    damping_nspm  of it
    """

    __slots__ = ("_drives", "_model", "_share", "_step_s", "damping_nspm", "force_n")

    def __init__(self, step_s: float, spring: tuple[float, float], model: Model, place_m: Sequence[float]) -> None:
        """place_m: of the tool, in the model's frame."""
        K, B = spring
        self._step_s, self._model = step_s, model
        held = K * step_s + B
        pull = step_s * model.stiffness_npm
        inverse = 1.0 / (MODEL_KG + step_s * (pull + model.damping_nspm + held))
        carried = step_s * DRIFTING * model.added_nspm
        self._drives: list[float] = []
        self.force_n: list[float] = []
        stretch = model.space.way(place_m, model.place_m)
        to_go = model.space.way(model.place_m, model.intention_m)
        for s, speed, way, drift in zip(stretch, model.velocity_mps, to_go, model.drift_mps, strict=True):
            spring_n = K * s
            drive = inverse * (MODEL_KG * speed + pull * way + carried * drift - step_s * spring_n)
            self._drives.append(drive)
            self.force_n.append(spring_n + held * drive)
        self._share = inverse * step_s * held
        self.damping_nspm = held * (1.0 - self._share)

    def end(self, velocity_mps: Sequence[float]) -> None:
        """Move the model by the step, after which the tool has this velocity."""
        model = self._model
        model.velocity_mps = [a + self._share * q for a, q in zip(self._drives, velocity_mps, strict=True)]
        model.place_m = model.space.moved(model.place_m, [self._step_s * v for v in model.velocity_mps])


def ahead(
    intention_m: Sequence[float], rate_mps: Sequence[float], age_s: float, space: Places = IN_PLACES
) -> list[float]:
    """Return where an intention is after this time, as far as the horizon."""
    reach = min(max(0.0, age_s), HORIZON_S)
    return space.moved(intention_m, [reach * rate for rate in rate_mps])


def step_object(
    step_s: float, place_m: list[float], velocity_mps: list[float], mass_kg: float, damping_nspm: float,
    spring: tuple[float, float], models: Sequence[Model], own: tuple[Sequence[float], Sequence[float]] | None = None,
) -> None:  # fmt: skip
    """Step object and models by one step on all axes, in place.

    place_m, velocity_mps  of the object
    spring                 K [N/m] and B [N s/m]
    own                    places and velocities of a hand that is measured and not modelled; None for none
    """
    K, B = spring
    G, stiff, damped = step_s * (K * step_s + B), step_s * K, step_s * B
    weight = mass_kg + step_s * damping_nspm + (G if own is not None else 0.0)
    shares = []
    for model in models:
        pull = step_s * model.stiffness_npm
        inverse = 1.0 / (MODEL_KG + step_s * (pull + model.damping_nspm) + G)
        weight += G - G * G * inverse
        carried = step_s * DRIFTING * model.added_nspm
        shares.append((model.place_m, model.velocity_mps, model.intention_m, pull, inverse, carried, model.drift_mps))
    for axis, o in enumerate(place_m):
        push = mass_kg * velocity_mps[axis]
        if own is not None:
            push += stiff * (own[0][axis] - o) + damped * own[1][axis]
        drives = []
        for places, speeds, intended, pull, inverse, carried, drift in shares:
            x = places[axis]
            force = stiff * (x - o)
            drive = inverse * (MODEL_KG * speeds[axis] + pull * (intended[axis] - x) + carried * drift[axis] - force)
            push += force + G * drive
            drives.append(drive)
        velocity_mps[axis] = v = push / weight
        place_m[axis] = o + step_s * v
        for (places, speeds, _, _, inverse, _, _), drive in zip(shares, drives, strict=True):
            speeds[axis] = speed = drive + inverse * G * v
            places[axis] += step_s * speed
