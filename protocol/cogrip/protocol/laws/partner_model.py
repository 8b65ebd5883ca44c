"""Model of a partner's hand about its intention, and one step of an object that several hold (theory 5b); both ends use it.

Symbols, per axis: o object, x_j device of partner j, e_j its intention, k_j its hand's stiffness, m_d, b_m mass and damping of
the model, K, B the spring of a seat, T step. Implicit Euler, copy and models together:

    f_j = K (x_j - o) + B (x_j' - o')       m_o o'' = sum_j f_j - d o'       m_d x_j'' = k_j (e_j - x_j) - b_m x_j' - f_j
"""

from collections.abc import Sequence

MODEL_KG = 0.1  # m_d
HAND_NSPM = 5.0  # b_e, damping of a hand in the estimate of its intention
ADDED_NSPM = (
    10.0  # what a model's damping b_m has above that, where it is late: it keeps the loop of two clients below 1
)
LATE_S = 0.1  # age of an intention from which on it has all of it
DAMPED_NPM = 150.0  # least stiffness of a hand whose model has all of b_m
HORIZON_S = 0.1  # h, the longest time for which an intention is taken to go on


class Model:
    """One partner's hand on all axes: where its device is taken to be, and how fast."""

    __slots__ = ("age_s", "intention_m", "place_m", "stiffness_npm", "velocity_mps")

    def __init__(self, place_m: Sequence[float]) -> None:
        self.place_m = list(place_m)
        self.velocity_mps = [0.0] * len(self.place_m)
        self.intention_m = list(place_m)
        self.stiffness_npm = 0.0
        self.age_s = LATE_S  # of the intention

    @property
    def damping_nspm(self) -> float:
        """b_m: less for a hand that hardly holds, none where it has let go."""
        full = HAND_NSPM + ADDED_NSPM * min(1.0, self.age_s / LATE_S)
        return full * min(1.0, self.stiffness_npm / DAMPED_NPM)


def ahead(intention_m: Sequence[float], rate_mps: Sequence[float], age_s: float) -> list[float]:
    """Return where an intention is after this time, as far as the horizon."""
    reach = min(max(0.0, age_s), HORIZON_S)
    return [place + reach * rate for place, rate in zip(intention_m, rate_mps, strict=True)]


def step_object(
    axis: int, step_s: float, motion: tuple[float, float], mass_kg: float, damping_nspm: float, spring: tuple[float, float],
    models: Sequence[Model], own: tuple[float, float] | None = None,
) -> tuple[float, float]:  # fmt: skip
    """Step object and models by one step on one axis. Return the object's place and velocity.

    motion  place [m] and velocity [m/s] of the object
    spring  K [N/m] and B [N s/m]
    own     place and velocity of a hand that is measured and not modelled; None for none
    """
    (o, v), (K, B) = motion, spring
    G = K * step_s + B
    pull, weight = mass_kg * v, mass_kg + step_s * damping_nspm
    if own is not None:
        x, speed = own
        pull += step_s * (K * (x - o) + B * speed)
        weight += step_s * G
    parts = []
    for model in models:
        stretch = model.place_m[axis] - o
        inertia = MODEL_KG + step_s * (model.stiffness_npm * step_s + model.damping_nspm + G)
        drive = MODEL_KG * model.velocity_mps[axis] + step_s * (
            model.stiffness_npm * (model.intention_m[axis] - model.place_m[axis]) - K * stretch
        )
        pull += step_s * K * stretch + step_s * G * drive / inertia
        weight += step_s * G - (step_s * G) ** 2 / inertia
        parts.append((drive, inertia))
    v = pull / weight
    for model, (drive, inertia) in zip(models, parts, strict=True):
        speed = (drive + step_s * G * v) / inertia
        model.velocity_mps[axis] = speed
        model.place_m[axis] += step_s * speed
    return o + step_s * v, v
