"""Linear discrete-time blocks, their expansion over one frame, and their interconnection.

    x+ = A x + B u        y = C x + D u

symbols: n states, p inputs, q outputs, M ticks in a frame. A (..., n, n), B (..., n, p), C (..., q, n), D (..., q, p); leading
axes are a batch of cases, broadcast against each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogrip.machine.addition import add_integers

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class StateSpace:
    """One block."""

    A: Array
    B: Array
    C: Array
    D: Array

    @property
    def states(self) -> int:
        return int(self.A.shape[-1])

    @property
    def inputs(self) -> int:
        return int(self.D.shape[-1])

    @property
    def outputs(self) -> int:
        return int(self.D.shape[-2])

    def response(self, z: Complex) -> Complex:
        """Return C (z I - A)^-1 B + D at the points z, shape (...); the result has shape (..., q, p)."""
        identity: Complex = np.eye(self.states, dtype=np.complex128)
        pencil = z[..., None, None] * identity - self.A
        right = np.broadcast_to(self.B, (*pencil.shape[:-1], self.inputs)).astype(np.complex128)
        answer = np.asarray(self.C @ np.linalg.solve(pencil, right) + self.D, dtype=np.complex128)
        return answer


def gain(matrix: Array) -> StateSpace:
    """Return a block without states: y = D u."""
    outputs, inputs = matrix.shape[-2:]
    return StateSpace(np.zeros((0, 0)), np.zeros((0, inputs)), np.zeros((outputs, 0)), matrix)


def delay(width: int, steps: int) -> StateSpace:
    """Return a delay of `steps` for `width` signals: past inputs, newest first in the state (steps = 0: no delay)."""
    if steps == 0:
        return gain(np.eye(width))
    n = width * steps
    A = np.eye(n, k=-width)
    B = np.zeros((n, width))
    B[:width] = np.eye(width)
    C = np.zeros((width, n))
    C[:, n - width :] = np.eye(width)
    return StateSpace(A, B, C, np.zeros((width, width)))


def diagonal(blocks: Sequence[StateSpace]) -> StateSpace:
    """Return blocks side by side: states, inputs and outputs one after the other."""
    return StateSpace(*(_diagonal([getattr(block, name) for block in blocks]) for name in "ABCD"))


def _diagonal(matrices: Sequence[Array]) -> Array:
    batch = np.broadcast_shapes(*(matrix.shape[:-2] for matrix in matrices))
    rows, columns = (add_integers(matrix.shape[axis] for matrix in matrices) for axis in (-2, -1))
    out = np.zeros((*batch, rows, columns))
    row = column = 0
    for matrix in matrices:
        height, width = matrix.shape[-2:]
        out[..., row : row + height, column : column + width] = matrix
        row, column = row + height, column + width
    return out


def series(first: StateSpace, second: StateSpace) -> StateSpace:
    """Return `second` fed by `first`; states of `first` come first."""
    A = _diagonal([first.A, second.A])
    A[..., first.states :, : first.states] = second.B @ first.C
    batch = A.shape[:-2]
    return StateSpace(
        A, _rows(batch, first.B, second.B @ first.D), _columns(batch, second.D @ first.C, second.C), second.D @ first.D
    )


def close(block: StateSpace, feedback: Array, external: Array | None = None) -> StateSpace:
    """Feed outputs back, u = F y + G w, with F (p, q) and G (p, r); the new inputs are w (P eq. 36 for G = 0).

    A' = A + B F (I - D F)^-1 C. Raises numpy's LinAlgError for a loop without delay that cannot be solved.
    """
    F = feedback
    G = np.zeros((block.inputs, 0)) if external is None else external
    loop = np.linalg.inv(np.eye(block.inputs) - F @ block.D)  # (I - F D)^-1, as F (I - D F)^-1 = (I - F D)^-1 F
    back, drive = loop @ F @ block.C, loop @ G
    return StateSpace(block.A + block.B @ back, block.B @ drive, block.C + block.D @ back, block.D @ drive)


def lift(block: StateSpace, ticks: int) -> StateSpace:
    """Expand a block over a frame (P eq. 22-30, after Araki): inputs and outputs of its M ticks stacked, tick by tick.

    A_D = A^M, B_D = [A^(M-1) B ... B], C_D = [C; C A; ...], D_D block-lower-triangular with C A^(i-j-1) B.
    """
    A, B, C, D = block.A, block.B, block.C, block.D
    n, p, q = block.states, block.inputs, block.outputs
    batch = np.broadcast_shapes(A.shape[:-2], B.shape[:-2], C.shape[:-2], D.shape[:-2])
    to_state = np.zeros((*batch, n, ticks * p))  # what the state is made of: inputs so far ...
    power = np.broadcast_to(np.eye(n), (*batch, n, n))  # ... and the state the frame began with
    outputs_from_state, outputs_from_inputs = [], []
    for tick in range(ticks):
        outputs_from_state.append(C @ power)
        row = C @ to_state
        row[..., tick * p : (tick + 1) * p] += D
        outputs_from_inputs.append(row)
        to_state = A @ to_state
        to_state[..., tick * p : (tick + 1) * p] += B
        power = A @ power
    return StateSpace(
        power,
        to_state,
        np.concatenate(outputs_from_state, axis=-2).reshape(*batch, ticks * q, n),
        np.concatenate(outputs_from_inputs, axis=-2),
    )


def through(before: Array, block: StateSpace, after: Array) -> StateSpace:
    """Return a block between two static maps: u = before w, z = after y."""
    return StateSpace(block.A, block.B @ before, after @ block.C, after @ block.D @ before)


def _rows(batch: tuple[int, ...], *parts: Array) -> Array:
    return np.concatenate([np.broadcast_to(part, (*batch, *part.shape[-2:])) for part in parts], axis=-2)


def _columns(batch: tuple[int, ...], *parts: Array) -> Array:
    return np.concatenate([np.broadcast_to(part, (*batch, *part.shape[-2:])) for part in parts], axis=-1)
