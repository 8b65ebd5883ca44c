"""The eigenvalues of a session that lie at 1 by its structure, removed exactly (docs/decisions/0006).

A is the map of one frame (`lifted_model`). Each freedom is a vector, and together, V (n, f), they span a subspace that the
map keeps: A V = V J, with ones on J's diagonal (`Rigid.residual`). With pivots p, one state a freedom such that the rows
V_p of V are invertible, and k the other states,

    A' = A_kk - R A_pk        R = V_k V_p^-1

has all eigenvalues of A but those of J; leading axes are a batch of stiffnesses.

Freedoms:
    device position i    waves carry velocities alone, so no force depends on it (virtual coupling: where K_i = 0)
    object position      forces depend on stretches alone; with virtual coupling it goes with the devices that are sprung to it
    stretch i            of a spring with K_i = 0
    tension i            where a hand's spring pulls the coupling's (K_h, K_i > 0): any force may stand,
                         f = K_i e_i = -K_h x_i, x_i the device; on an object that may move these sum to 0, one freedom less
    uniform motion       everyone who is coupled, and the object, at one velocity: where no damper and no hand brakes it;
                         a person without coupling (K_i = B_i = 0) alone. Virtual coupling brakes it by its old
                         positions, or drives it where there is no delay (theory section 5), unless K = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from cogrip.analysis.linear.client_blocks import gliding, kept_waves, pressed, sent_later
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import LinearPerson
from cogrip.analysis.linear.state_space import Array


@dataclass(frozen=True, slots=True)
class Freedom:
    """One vector, shape (..., n), and the state to leave out for it."""

    name: str
    vector: Array
    pivot: int


class Rigid:
    """All freedoms of a model with stiffnesses K [N/m], shape (..., N), zero for the same users in all cases.

    None: the session's. vectors: V, (n, f), or (..., n, f) where hands hold tension.
    """

    def __init__(self, model: LiftedModel, stiffness_npm: Array | None = None) -> None:
        K = np.array(model.session.stiffness_npm) if stiffness_npm is None else stiffness_npm
        some = tuple(K.reshape(-1, model.users)[0].tolist())
        waves = model.session.traits.waves
        found = [*_of_waves(model, some), *_tensions(model, K)] if waves else _of_coupling(model, some)
        self.names = tuple(freedom.name for freedom in found)
        vectors = np.broadcast_arrays(np.zeros(model.states), *(freedom.vector for freedom in found))
        self.vectors: Array = np.stack(vectors, axis=-1)[..., 1:]
        self._pivots = np.array([freedom.pivot for freedom in found], dtype=np.intp)
        self._others = np.delete(np.arange(model.states), self._pivots)
        self._R = self.vectors[..., self._others, :] @ np.linalg.inv(self.vectors[..., self._pivots, :])

    @property
    def for_any_stiffness(self) -> bool:
        """True where the same vectors hold for all stiffnesses above 0: no hand holds a tension."""
        return self.vectors.ndim == 2

    def removed(self, matrix: Array) -> Array:
        """Return A', (..., n - f, n - f), of a closed-loop matrix (..., n, n)."""
        columns = matrix[..., self._others]
        rest: Array = columns[..., self._others, :] - self._R @ columns[..., self._pivots, :]
        return rest

    def residual(self, matrix: Array) -> float:
        """Return the largest entry of A V - V J, and of |eigenvalue of J - 1|, for one matrix (n, n)."""
        V = self.vectors
        J = np.linalg.solve(V[self._pivots], (matrix @ V)[self._pivots])
        off = np.abs(matrix @ V - V @ J).max(initial=0.0)
        return float(
            max(off, np.abs(np.diag(np.triu(J)) - 1.0).max(initial=0.0), np.abs(np.tril(J, -1)).max(initial=0.0))
        )


def _of_waves(model: LiftedModel, K: tuple[float, ...]) -> list[Freedom]:
    session, layout = model.session, model.layout
    people, N = session.people, model.users
    first = layout.server.start
    found = [
        _unit(model, f"device position of {person.name}", layout.clients[i].start)
        for i, person in enumerate(people)
        if person.hand_stiffness_npm == 0.0
    ]
    if not session.fixed:
        found.append(_unit(model, "object position", first + N))
    found += [_unit(model, f"stretch of {people[i].name}", first + i) for i in range(N) if K[i] == 0.0]
    coupled = [i for i in range(N) if K[i] > 0.0 or people[i].damping_nspm > 0.0]
    for group, name in _moving_together(model, coupled):
        vector = np.zeros(model.states)
        for i in group:
            _glide(model, i, vector)
        with_object = not session.fixed and (group == coupled or not group)
        if with_object:
            vector[first + N + 1] = 1.0
        pivot = first + N + 1 if with_object else layout.clients[group[0]].start + 1
        found.append(Freedom(f"uniform motion of {name}", vector, pivot))
    return found


def _tensions(model: LiftedModel, stiffness: Array) -> list[Freedom]:
    session, layout = model.session, model.layout
    people = session.people
    sprung = (stiffness.reshape(-1, model.users)[0] > 0.0).tolist()
    held = [i for i in range(model.users) if sprung[i] and people[i].hand_stiffness_npm > 0.0]
    found = []
    for i in held if session.fixed else held[1:]:
        vector = np.zeros((*stiffness.shape[:-1], model.states))
        _pull(model, i, stiffness[..., i], stiffness[..., i], vector)
        name = f"tension of {people[i].name}"
        if not session.fixed:
            _pull(model, held[0], -stiffness[..., i], stiffness[..., held[0]], vector)
            name = f"tension between {people[held[0]].name} and {people[i].name}"
        found.append(Freedom(name, vector, layout.server.start + i))
    return found


def _pull(model: LiftedModel, user: int, force: Array, stiffness: Array, vector: Array) -> None:
    """Enter one user's part of a standing force f: nothing moves, so u = -v = f / sqrt(2b) (theory section 1)."""
    layout = model.layout
    person = model.session.people[user]
    wave = (force / sqrt(2.0 * person.impedance_nspm))[..., None]
    own = layout.clients[user]
    vector[..., own.start] = -force / person.hand_stiffness_npm
    if (part := sent_later(person)) or person.decimator == "lowpass":
        vector[..., own.stop - 1] = (part or 1.0) * wave[..., 0]
    vector[..., own][..., kept_waves(person)] = -wave
    for states, each in pressed(person):
        vector[..., own][..., states] = each * force[..., None]
    vector[..., layout.ups[user]], vector[..., layout.downs[user]] = wave, -wave
    vector[..., layout.server.start + user] = force / stiffness
    if model.session.traits.lagged:
        vector[..., layout.server.stop - model.users + user] = force


def _moving_together(model: LiftedModel, coupled: list[int]) -> list[tuple[list[int], str]]:
    """Return groups that nothing brakes: the object with everyone coupled to it, and each of the others."""
    session = model.session
    people = session.people
    groups: list[tuple[list[int], str]] = []
    if not session.fixed and session.object_damping_nspm == 0.0 and all(_free(people[i]) for i in coupled):
        groups.append((coupled, "object and devices" if coupled else "the object"))
    groups += [([i], people[i].name) for i in range(model.users) if i not in coupled and _free(people[i])]
    return groups


def _free(person: LinearPerson) -> bool:
    return person.device_damping_nspm == person.hand_damping_nspm == person.hand_stiffness_npm == 0.0


def _glide(model: LiftedModel, user: int, vector: Array) -> None:
    """Enter one user's part of a uniform motion at 1 m/s: velocities 1, waves sqrt(b/2) in both directions, no force.

    P's step sees a stretch before the hand's proxy has moved along, so e = -T v there.
    """
    session, layout = model.session, model.layout
    person = session.people[user]
    wave = sqrt(0.5 * person.impedance_nspm)
    own = vector[layout.clients[user]]
    for part in gliding(person):
        own[part] = 1.0
    own[kept_waves(person)] = wave
    if (later := sent_later(person)) or person.decimator == "lowpass":
        own[-1] = (later or 1.0) * wave
    vector[layout.ups[user]] = vector[layout.downs[user]] = wave
    if session.traits.lagged:
        vector[layout.server.start + user] = -session.frame_s


def _of_coupling(model: LiftedModel, K: tuple[float, ...]) -> list[Freedom]:
    session = model.session
    people, N = session.people, model.users
    sprung = [i for i in range(N) if K[i] > 0.0]
    found = [
        _place(model, [i], False, f"device position of {people[i].name}")
        for i in range(N)
        if i not in sprung and people[i].hand_stiffness_npm == 0.0
    ]
    if not session.fixed and all(people[i].hand_stiffness_npm == 0.0 for i in sprung):
        found.append(_place(model, sprung, True, "joint position" if sprung else "object position"))
    coupled = [i for i in range(N) if K[i] > 0.0 or people[i].damping_nspm > 0.0]
    for group, name in _moving_together(model, coupled):
        if not any(i in sprung for i in group):
            found.append(_drift(model, group, not session.fixed and (group == coupled or not group), name))
    return found


def _place(model: LiftedModel, users: list[int], with_object: bool, name: str) -> Freedom:
    """Return devices, and the object, 1 m further on, as in every frame under way."""
    layout = model.layout
    vector = np.zeros(model.states)
    for i in users:
        vector[layout.clients[i].start] = 1.0
        vector[layout.ups[i]][0::2] = 1.0
    if with_object:
        vector[layout.server.start] = 1.0
        for down in layout.downs:
            vector[down][0::2] = 1.0
    return Freedom(name, vector, layout.server.start if with_object else layout.clients[users[0]].start)


def _drift(model: LiftedModel, users: list[int], with_object: bool, name: str) -> Freedom:
    """Return a uniform motion where dampers alone couple: a device's place k steps old is k T behind, an answer (k - 1) T,
    as it is of the object after its step.
    """
    layout, T = model.layout, model.session.frame_s
    vector = np.zeros(model.states)
    for i in users:
        person, own = model.session.people[i], vector[layout.clients[i]]
        for part in gliding(person):
            own[part] = 1.0
        late_s = person.latency_ticks * person.rates.tick_s
        vector[layout.ups[i]] = _trail(vector[layout.ups[i]].size, T, late_s)
    if with_object:
        vector[layout.server.start + 1] = 1.0
        for down in layout.downs:
            vector[down] = _trail(vector[down].size, T, -T)
    return Freedom(
        f"uniform motion of {name}",
        vector,
        layout.server.start + 1 if with_object else layout.clients[users[0]].start + 1,
    )


def _trail(size: int, period: float, late_s: float) -> Array:
    steps = np.arange(1, size // 2 + 1)
    return np.column_stack((-period * steps - late_s, np.ones(size // 2))).ravel()


def _unit(model: LiftedModel, name: str, entry: int) -> Freedom:
    vector = np.zeros(model.states)
    vector[entry] = 1.0
    return Freedom(name, vector, entry)
