"""Shapes that bodies are drawn of, as messages and recordings have them: their kinds, bounds, and how surfaces are packed."""

from collections.abc import Sequence
from struct import Struct, iter_unpack
from typing import Annotated, Literal

import msgspec

from cogrip.machine.rows import Vector

ShapeKind = Literal["box", "sphere", "capsule", "cylinder", "ellipsoid", "plane", "mesh", "flex", "tendon"]
Two = Annotated[tuple[float, ...], msgspec.Meta(min_length=2, max_length=2)]
Three = Annotated[tuple[float, ...], msgspec.Meta(min_length=3, max_length=3)]
Four = Annotated[tuple[float, ...], msgspec.Meta(min_length=4, max_length=4)]
MOST_SHAPES = 1024  # most shapes of a scene, and most bodies that move; further ones are left out
_TRIANGLE = Struct("<9H")
MOST_TRIANGLES = 55
"""Most triangles of one shape, so that its message fits a datagram; a larger surface is several shapes."""
MOST_SURFACE_BYTES = MOST_TRIANGLES * _TRIANGLE.size  # most bytes of a shape's triangles and their colours
RGB_BYTES = 3  # bytes of a triangle's colour
MOST_COLOURED = MOST_SURFACE_BYTES // (_TRIANGLE.size + RGB_BYTES)  # most triangles of one shape that have colours
MOST_PERIOD_M = 1e6
TILE = 18  # number of colours along each side of a plane's tile
_NUMBER = Struct("<H")
MOST_POINTS = MOST_SURFACE_BYTES // _NUMBER.size  # most points of one shape of points that move
_COUNTS = 65535  # largest number that stands for a coordinate: the far side of the box around a surface
MOST_LOCAL = 64  # most shapes with which a player's client renders contact itself
MOST_COPIED = 32  # most shapes of which a client makes its copy of a scene
OBJECT_NUMBERS = 14  # numbers of the inertia of a scene's object
TURNING_NUMBERS, WELDED_NUMBERS = 12, 15
"""Numbers of the inertia of a tool that turns, and of one that is welded to the object."""
MOST_PAIRS = 256  # most pairs of a ball and a fixed shape among the shapes of local contact
UNTURNED: Four = (1.0, 0.0, 0.0, 0.0)


class Solid(msgspec.Struct, frozen=True, array_like=True):
    """Substance of a shape, of which a client makes its own copy of a scene (`SPEC.md` section 7e).

    friction  sliding, spinning [m] and rolling [m], as MJCF has them
    bits      contype and conaffinity: two shapes touch where the one of either and the other of the other share a bit
    inertia   of a tool its mass [kg], of one that turns 12 numbers: mass, place of its middle in its frame [m], moments about
              that [kg m^2], the orientation of their axes, and the part of its weight that is carried; where it is welded to
              the object 3 more: its place from there at the start [m]; of the object the first 11, and the acceleration of
              its fall [m/s^2]; at the first shape of the body
    """

    friction: Annotated[
        tuple[Annotated[float, msgspec.Meta(ge=0.0, le=1e3)], ...], msgspec.Meta(min_length=3, max_length=3)
    ]
    bits: Annotated[tuple[Annotated[int, msgspec.Meta(ge=0, lt=2**31)], ...], msgspec.Meta(min_length=2, max_length=2)]
    inertia: Annotated[
        tuple[Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)], ...], msgspec.Meta(max_length=WELDED_NUMBERS)
    ] = ()


class Shape(msgspec.Struct, frozen=True):
    """A drawn shape of a scene, in the frame of its body or, fixed to the world, in the object's frame at the start.

    body         number of its body among those that move and have shapes; None: it is fixed
    size_m       as MJCF has it: radius, half lengths; of a plane 0 along an axis that has no end
                 of a mesh half the edges of the box around it
    orientation  quaternion w, x, y, z
    rgba         None where the scene gives no colour
    triangles    of a mesh, else unset: a part of its surface (`pack_triangles`)
    colours      with a texture, else unset: red, green, blue, a byte each, instead of rgba's: of each triangle of a mesh, of
                 the TILE x TILE cells of a tile that repeats on a plane, by rows from the largest y
    period_m     of a plane with a tile its lengths along x and y; one begins at the corner of the least x and the largest y,
                 along an axis without end the middle of one is the plane's
    points       of a flex its triangles, three bodies each; of a tendon its path, two bodies or more (`pack_points`)

    solid        of a shape of which a client's copy of a scene is made, else unset

    A flex and a tendon have no place: their points are the places of bodies. size_m is the radius of a tendon, else 0.
    """

    kind: ShapeKind
    size_m: Three
    body: Annotated[int, msgspec.Meta(ge=0, lt=MOST_SHAPES)] | None = None
    place_m: Three = (0.0, 0.0, 0.0)
    orientation: Four = UNTURNED
    rgba: Four | None = None
    seat: int | None = None  # seat whose tool the shape is part of
    object: bool = False  # the shape is part of the room's object
    triangles: bytes | msgspec.UnsetType = msgspec.UNSET
    colours: bytes | msgspec.UnsetType = msgspec.UNSET
    points: bytes | msgspec.UnsetType = msgspec.UNSET
    period_m: Two | msgspec.UnsetType = msgspec.UNSET
    solid: Solid | msgspec.UnsetType = msgspec.UNSET

    def __post_init__(self) -> None:
        check_triangles(self.kind, self.triangles or b"")
        check_colours(self.kind, self.triangles or b"", self.colours or b"", self.period_m or None)
        check_points(self.kind, self.points or b"")

    @property
    def soft(self) -> bool:
        """True where it runs through points that move."""
        return self.kind in ("flex", "tendon")

    @property
    def bodies(self) -> tuple[int, ...]:
        """Numbers of the bodies that it follows: of a flex and a tendon all its points, in order."""
        if self.points:
            return tuple([number for (number,) in _NUMBER.iter_unpack(self.points)])
        return () if self.body is None else (self.body,)

    def triangle_colours(self) -> list[Vector]:
        """Return red, green, blue of each triangle or cell, 0 to 1; none where the whole shape has one colour."""
        shares = [each / 255 for each in self.colours or b""]
        return [(shares[at], shares[at + 1], shares[at + 2]) for at in range(0, len(shares), RGB_BYTES)]

    def corners_m(self) -> list[Vector]:
        """Return the corners of a mesh's triangles in the shape's own frame [m], three by three; none of other kinds."""
        scale = [2.0 * half / _COUNTS for half in self.size_m]
        counts = [each for row in iter_unpack(_TRIANGLE.format, self.triangles or b"") for each in row]
        at = [scale[n % 3] * count - self.size_m[n % 3] for n, count in enumerate(counts)]
        return [(at[n], at[n + 1], at[n + 2]) for n in range(0, len(at), 3)]


def pack_triangles(corners_m: Sequence[Sequence[Sequence[float]]], half_m: Sequence[float]) -> bytes:
    """Return triangles of three corners [m] each, outside counter-clockwise, in a box of these half edges about the origin.

    A coordinate is an unsigned 16-bit number, little-endian: 0 at -half, 65535 at half.
    """
    packed = b""
    for triangle in corners_m:
        places = [(at, half) for place in triangle for at, half in zip(place, half_m, strict=True)]
        shares = [0.5 + 0.5 * at / half if half > 0.0 else 0.5 for at, half in places]
        packed += _TRIANGLE.pack(*[round(_COUNTS * min(1.0, max(0.0, share))) for share in shares])
    return packed


def check_triangles(kind: ShapeKind, triangles: bytes) -> None:
    """Raise ValueError for triangles that are not whole, for too many, and for those of another kind than a mesh."""
    size, each = len(triangles), _TRIANGLE.size
    if size and (kind != "mesh" or size > MOST_SURFACE_BYTES or size % each):
        raise ValueError(
            f"a {kind} with {size} bytes of triangles; a mesh has at most {MOST_TRIANGLES} of {each} bytes"
        )


def pack_points(bodies: Sequence[int]) -> bytes:
    """Return numbers of bodies, unsigned 16-bit, little-endian."""
    return b"".join([_NUMBER.pack(body) for body in bodies])


def check_colours(kind: ShapeKind, triangles: bytes, colours: bytes, period_m: Sequence[float] | None) -> None:
    """Raise ValueError for colours that are not one of each triangle or cell, for too many, and for a tile without size."""
    count = TILE * TILE if kind == "plane" else len(triangles) // _TRIANGLE.size
    tiled = bool(colours) and kind == "plane"
    if colours and (len(colours) != RGB_BYTES * count or (kind != "plane" and count > MOST_COLOURED)):
        raise ValueError(
            f"{len(colours)} bytes of colours; {RGB_BYTES} for each of {count} triangles or cells, {MOST_COLOURED} triangles "
            "at most"
        )
    if (period_m is not None) != tiled or (tiled and not all(0.0 < each <= MOST_PERIOD_M for each in period_m or ())):
        raise ValueError(f"a {kind} whose tile repeats after {period_m} m; it does where it has colours, above 0")


def check_points(kind: ShapeKind, points: bytes) -> None:
    """Raise ValueError for points of a kind that has none, too few or too many, no whole triangle, and no number of a body."""
    count, odd = divmod(len(points), _NUMBER.size)
    fits = {"flex": count % 3 == 0, "tendon": count != 1}.get(kind, not points)
    if (
        not fits
        or odd
        or count > MOST_POINTS
        or any(number >= MOST_SHAPES for (number,) in _NUMBER.iter_unpack(points))
    ):
        raise ValueError(
            f"a {kind} with {len(points)} bytes of points; a flex has three a triangle, a tendon not one alone, "
            f"2 bytes each, {MOST_POINTS} at most, below {MOST_SHAPES}; others have none"
        )
