"""Textures of a scene as they are drawn: a tile that repeats on a plane, a colour of each triangle on what is not flat.

Where a texture lies is MuJoCo's rule, as its pictures show it. A flat image is repeated `texrepeat` times along x and y, or
that often in two metres where `texuniform` or there is no end: on a plane from the corner at the least x and the largest y, on
a height field and on a plane without end such that its middle is the geom's. On a mesh it lies by the mesh's own coordinates.
Six images lie around, by direction from the geom's middle. Other forms have the mean colour of a flat image.
"""

from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from cogrip.protocol.drawing import MOST_PERIOD_M, TILE

Array = NDArray[np.float64]
_RGB = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
_FLAT, _CUBE = int(mujoco.mjtTexture.mjTEXTURE_2D), int(mujoco.mjtTexture.mjTEXTURE_CUBE)
_FINER = 4  # number of places along each side of a tile's cell whose colours are averaged
_WITHIN = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 2]]) / 6.0
"""Places within a triangle whose colours are averaged, as weights of its corners."""


class Texture(NamedTuple):
    """pixels: of one image or of six, rows, columns, red green blue, 0 to 1; repeat: along x and y; uniform: a metre."""

    pixels: Array
    repeat: Array
    uniform: bool

    @property
    def mean(self) -> Array:
        """Mean red, green, blue."""
        found: Array = self.pixels.reshape(-1, 3).mean(axis=0)
        return found

    @property
    def cube(self) -> bool:
        """True where there are six images around."""
        return self.pixels.ndim == 4


def texture_of(model: mujoco.MjModel, material: int) -> Texture | None:
    """Return the texture of a material's colour; None where it has none."""
    number = int(model.mat_texid[material, _RGB]) if material >= 0 else -1
    if number < 0 or model.tex_type[number] not in (_FLAT, _CUBE):
        return None
    height, width = int(model.tex_height[number]), int(model.tex_width[number])
    channels, first = int(model.tex_nchannel[number]), int(model.tex_adr[number])
    data = model.tex_data[first : first + height * width * channels].reshape(height, width, channels)
    pixels = (data[..., :3] if channels > 2 else np.repeat(data[..., :1], 3, axis=2)) / 255.0
    if model.tex_type[number] == _CUBE:
        six = height == 6 * width  # else one image is on all sides
        pixels = pixels.reshape(6, width, width, 3) if six else np.broadcast_to(pixels, (6, *pixels.shape))
    return Texture(pixels, model.mat_texrepeat[material].astype(float), bool(model.mat_texuniform[material]))


def tile_of(texture: Texture, half_m: Array) -> tuple[Array, tuple[float, float]]:
    """Return the colours of a plane's tile, shape (TILE, TILE, 3), first row at the largest y, and its length along x and y.

    half_m: half sides of the plane [m], 0 where it has no end.
    """
    height, width = texture.pixels.shape[:2]
    rows, columns = (
        ((np.arange(TILE * _FINER) + 0.5) * size / (TILE * _FINER)).astype(int) for size in (height, width)
    )
    cells = texture.pixels[np.ix_(rows, columns)].reshape(TILE, _FINER, TILE, _FINER, 3).mean(axis=(1, 3))
    sides = [2.0 if texture.uniform or half <= 0.0 else 2.0 * half for half in half_m[:2].tolist()]
    x, y = (
        min(MOST_PERIOD_M, side / max(1e-6, each)) for side, each in zip(sides, texture.repeat.tolist(), strict=True)
    )
    return cells, (x, y)


def colours_of(texture: Texture, corners: Array, half_m: Array, coordinates: Array | None) -> Array:
    """Return the mean colour of each triangle, shape (triangles, 3).

    corners: in the geom's frame [m], shape (triangles, 3, 3); half_m: what of it is scaled to 1; coordinates: on the image of
    the corners, shape (triangles, 3, 2), where a mesh has them
    """
    whole = corners if coordinates is None else coordinates
    inside = np.add.reduce(_WITHIN[:, :, None] * whole[:, None], axis=2)
    if coordinates is not None:
        found = _at(texture.pixels, inside * texture.repeat)
    elif texture.cube:
        found = _around(texture.pixels, inside if texture.uniform else inside / np.maximum(half_m, 1e-9))
    else:
        sides = np.full(2, 2.0) if texture.uniform else 2.0 * np.maximum(half_m[:2], 1e-9)
        found = _at(texture.pixels, texture.repeat / sides * inside[..., :2] * [1.0, -1.0] - 0.5)
    mean: Array = found.mean(axis=1)
    return mean


def _at(pixels: Array, places: Array) -> Array:
    """Return the colours of an image at places of which each whole number is an image on; the first row is at 0."""
    height, width = pixels.shape[:2]
    columns = np.minimum((places[..., 0] % 1.0 * width).astype(int), width - 1)
    rows = np.minimum((places[..., 1] % 1.0 * height).astype(int), height - 1)
    found: Array = pixels[rows, columns]
    return found


def _around(pixels: Array, directions: Array) -> Array:
    """Return the colours of six images (right, left, up, down, front, back, as OpenGL has them) in some directions."""
    x, y, z = np.moveaxis(directions, -1, 0)
    longest = np.argmax(np.abs(directions), axis=-1)
    positive = np.take_along_axis(directions, longest[..., None], axis=-1)[..., 0] > 0.0
    far = np.maximum(np.abs(directions).max(axis=-1), 1e-12)
    sign = np.where(positive, 1.0, -1.0)
    s = np.select([longest == 0, longest == 1], [-sign * z, x], sign * x) / far
    t = np.where(longest == 1, sign * z, -y) / far
    columns, rows = (
        np.clip(((each + 1.0) / 2.0 * size).astype(int), 0, size - 1)
        for each, size in ((s, pixels.shape[2]), (t, pixels.shape[1]))
    )
    found: Array = pixels[2 * longest + ~positive, rows, columns]
    return found
