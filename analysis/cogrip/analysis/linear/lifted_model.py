"""The closed loop of a whole session over one network frame (P eq. 19-36, after Araki).

    x[k+1] = A x[k]        A = A_D + B_D F (I - D_D F)^-1 C_D        (P eq. 36)

Each block is expanded over the frame's M ticks, then they are joined, for each user i:

    down_i (delay, wave filter) -> client_i (hold, M ticks of device, law, encoder, filter, decimator)
    -> up_i (wave filter, delay) -> server step -> down_i

Order inside a frame, as in theory section 6: clients run their M ticks on the wave that has come back, and send; the
server steps with what has reached it; its answer, as of after the step, is seen in the next frame, so the downlink holds
one frame more than its delay. A client of virtual coupling sends its place as of the frame's start, which is the end of the
one before, so the answer to that is seen in this frame: there is no such frame in its downlink. No loop is without delay:
with G all users' chains and S the server, D_G = 0 and P eq. 36 is

    A = [ A_G + B_G D_S C_G    B_G C_S ]
        [ B_S C_G              A_S     ]

States: for each user the frames in the downlink, the client's (position x, velocity y, velocity estimator, what is kept
where samples are old, filter), the frames in the uplink; then the server's (stretches e, object x_o and v_o, forces of the
step before for `paper`).

Only the sum of both delays counts. What it has beyond whole frames splits the frame that is sent: its first ticks
still have the wave before (`wave_frame`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from cogrip.analysis.linear.client_blocks import coupled_frame, wave_filter, wave_frame
from cogrip.analysis.linear.linear_session import Form, LinearPerson, LinearSession
from cogrip.analysis.linear.server_blocks import coupled_step, paper_step, passive_step
from cogrip.analysis.linear.state_space import Array, Complex, StateSpace, delay, diagonal, series
from cogrip.protocol.settings.rates import Rates


@dataclass(frozen=True, slots=True)
class FormParts:
    """The parts of a form.

    width         signals in each direction of a user's line
    server_delay  frames from what a client sends to the answer in its ticks, without a link
    stiff_client  K stands in the client's law
    """

    client: Callable[[LinearPerson, Array, Rates], StateSpace]
    server: Callable[[LinearSession, Array], StateSpace]
    width: int
    server_delay: int
    stiff_client: bool


def _wave_client(person: LinearPerson, stiffness: Array, rates: Rates) -> StateSpace:
    return wave_frame(person, rates)  # K is the server's alone


KINDS: dict[Form, FormParts] = {
    "passive": FormParts(_wave_client, passive_step, 1, 1, False),
    "paper": FormParts(_wave_client, paper_step, 1, 1, False),
    "coupling": FormParts(coupled_frame, coupled_step, 2, 0, True),
}


@dataclass(frozen=True, slots=True)
class StateLayout:
    """The slices of each part's states: one a user for client and lines, one for the server."""

    downs: tuple[slice, ...]
    clients: tuple[slice, ...]
    ups: tuple[slice, ...]
    server: slice


class LiftedModel:
    """The map of one frame, for any stiffnesses K of its users; everything else is `session`'s."""

    def __init__(self, session: LinearSession) -> None:
        self.session = session
        self.kind = kind = KINDS[session.form]
        self.users = len(session.people)
        self._ups = [
            reduce(series, (*wave_filter(person), delay(kind.width, person.up_frames))) for person in session.people
        ]
        self._downs = [
            reduce(series, (delay(kind.width, person.down_frames + kind.server_delay), *wave_filter(person)))
            for person in session.people
        ]
        here = np.array(session.stiffness_npm)
        clients = [self.client(number, here) for number in range(self.users)]
        self._clients_always = None if kind.stiff_client else clients
        self._chains_always = None if kind.stiff_client else self._chains(here)
        self.layout = self._lay_out(clients, kind.server(session, here).states)
        self.states = self.layout.server.stop

    def matrix(self, stiffness_npm: Array | Sequence[float] | None = None) -> Array:
        """Return the closed-loop matrix, (..., n, n), for stiffnesses K [N/m] of shape (..., N); None: the session's own."""
        K = np.asarray(self.session.stiffness_npm if stiffness_npm is None else stiffness_npm, dtype=float)
        chains = self._chains_always or self._chains(K)
        server = self.kind.server(self.session, K)
        first = self.layout.server.start
        A = np.empty((*K.shape[:-1], self.states, self.states))
        A[..., :first, :first] = chains.A + chains.B @ (server.D @ chains.C)
        A[..., :first, first:] = chains.B @ server.C
        A[..., first:, :first] = server.B @ chains.C
        A[..., first:, first:] = server.A
        return A

    def characteristic(self, z: Complex, stiffness_npm: Array) -> Complex:
        """Return det(I - S(z) G(z)), shape (...): zero where z is an eigenvalue. z (...), K (..., N).

        Poles, and modes that never meet the server (device and object position), do not show.
        """
        width, N = self.kind.width, self.users
        server = self.kind.server(self.session, stiffness_npm).response(z)
        loop = np.empty((*z.shape, width * N, width * N), dtype=np.complex128)
        for number, person in enumerate(self.session.people):
            frames = person.up_frames + person.down_frames + self.kind.server_delay
            client = self._clients_always[number] if self._clients_always else self.client(number, stiffness_npm)
            mine = slice(number * width, (number + 1) * width)
            path = z**-frames * person.filtered(z) ** 2
            loop[..., mine, :] = (client.response(z) * path[..., None, None]) @ server[..., mine, :]
        determinant: Complex = np.linalg.det(np.eye(width * N) - loop)
        return determinant

    def client(self, number: int, stiffness: Array) -> StateSpace:
        """Return one user's client for stiffnesses K [N/m], (..., N)."""
        person = self.session.people[number]
        return self.kind.client(person, stiffness[..., number], person.rates)

    def _chains(self, stiffness: Array) -> StateSpace:
        """Return everything but the server, from its answers to its inputs."""
        return diagonal(
            [
                series(series(down, self.client(number, stiffness)), up)
                for number, (down, up) in enumerate(zip(self._downs, self._ups, strict=True))
            ]
        )

    def _lay_out(self, clients: Sequence[StateSpace], server_states: int) -> StateLayout:
        parts: tuple[list[slice], list[slice], list[slice]] = ([], [], [])
        start = 0
        for blocks in zip(self._downs, clients, self._ups, strict=True):
            for part, block in zip(parts, blocks, strict=True):
                part.append(slice(start, start + block.states))
                start += block.states
        downs, these, ups = parts
        return StateLayout(tuple(downs), tuple(these), tuple(ups), slice(start, start + server_states))
