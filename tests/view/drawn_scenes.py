"""Twenty small scenes, one of each kind of thing that is drawn and some mixed, as MJCF text."""

from itertools import product
from math import cos, pi, sin

import numpy as np

_FREE = '<body pos="0 0 .05"><freejoint/>{}</body>'
_GEOM = '<geom type="{}" size="{}" rgba="{}" mass=".2"/>'


def _scene(world: str, assets: str = "", more: str = "") -> str:
    return (
        '<mujoco><option gravity="0 0 0"/><visual><headlight ambient=".6 .6 .6" diffuse=".4 .4 .4" specular="0 0 0"/></visual>'
        f"<asset>{assets}</asset><worldbody>{world}</worldbody>{more}</mujoco>"
    )


def _one(kind: str, size: str, rgba: str) -> str:
    return _scene(_FREE.format(_GEOM.format(kind, size, rgba)))


def _ring(outer_m: float, inner_m: float, high_m: float, count: int = 24) -> str:
    """Return a mesh that its hull is not: a ring, about z."""
    corners, faces = [], []
    for at in range(count):
        c, s = cos(2 * pi * at / count), sin(2 * pi * at / count)
        corners += [(r * c, r * s, z) for r, z in product((outer_m, inner_m), (-high_m, high_m))]
        here, there = 4 * at, 4 * ((at + 1) % count)
        for a, b in ((0, 1), (1, 3), (3, 2), (2, 0)):
            faces += [(here + a, there + a, there + b), (here + a, there + b, here + b)]
    vertex = " ".join(f"{each:.6g}" for corner in corners for each in corner)
    return f'vertex="{vertex}" face="{" ".join(str(each) for face in faces for each in face)}"'


def _bump(size: int) -> str:
    """Return the elevations of a hill beside a valley."""
    u, v = np.meshgrid(np.linspace(-2, 2, size), np.linspace(-2, 2, size))
    rows = np.exp(-((u - 0.7) ** 2) - v**2) + 0.5 * np.exp(-((u + 1) ** 2) - (v - 1) ** 2)
    return " ".join(f"{each:.4f}" for each in rows.ravel())


_BRICK = _FREE.format('<geom type="box" size=".02 .03 .02" rgba=".9 .3 .1 1" mass=".2"/>')
_FLOOR = '<geom type="plane" size=".15 .12 .01" rgba=".3 .5 .3 1"/>'
_HILL = f'<hfield name="hill" nrow="40" ncol="40" size=".1 .08 .05 .01" elevation="{_bump(40)}"/>'
_RING = f'<mesh name="ring" {_ring(0.08, 0.05, 0.02)}/>'
_CLOTH = (
    '<flexcomp name="cloth" type="grid" dim="2" count="9 9 1" spacing=".02 .02 .02" pos="0 0 .1" radius=".001"'
    ' rgba=".2 .4 .9 1" mass=".1"><edge equality="true" damping=".1"/></flexcomp>'
)
_JELLY = (
    '<flexcomp name="jelly" type="grid" dim="3" count="5 5 5" spacing=".02 .02 .02" pos="0 0 .06" radius=".001"'
    ' rgba=".9 .3 .6 1" mass=".2"><edge equality="true"/></flexcomp>'
)
_ROPE = (
    '<flexcomp name="rope" type="grid" dim="1" count="12 1 1" spacing=".015 .015 .015" pos="0 0 .08" radius=".006"'
    ' rgba=".8 .7 .2 1" mass=".1"><edge equality="true"/></flexcomp>'
)
_PULLED = (
    '<site name="wall" pos="-.1 0 .1" size=".008" rgba=".9 .8 .1 1"/><geom name="post" type="cylinder" size=".025 .05"'
    ' pos="0 0 .1" euler="90 0 0" rgba=".5 .3 .2 1" contype="0" conaffinity="0"/><site name="side" pos="0 0 .15" size=".003"/>'
    '<body pos=".1 0 .05"><joint type="slide" axis="0 0 1" damping="1"/><geom type="sphere" size=".02" rgba=".2 .6 .9 1"/>'
    '<site name="ball" size=".008" rgba=".9 .2 .1 1" pos="0 0 .02"/></body>'
)
_TENDON = (
    '<tendon><spatial width=".005" rgba=".1 .7 .2 1"><site site="wall"/><geom geom="post" sidesite="side"/>'
    '<site site="ball"/></spatial></tendon>'
)
_CHECKER = (
    '<texture name="check" type="2d" builtin="checker" rgb1=".9 .9 .8" rgb2=".2 .3 .5" width="128" height="128"/>'
    '<material name="check" texture="check" texrepeat="3 3"/>'
)
_CROSS = (
    '<texture name="cross" type="2d" builtin="gradient" mark="cross" rgb1=".9 .6 .2" rgb2=".2 .5 .9" markrgb="0 0 0" width="18"'
    ' height="18"/><material name="cross" texture="cross" texrepeat="2 3"/>'
)
_CUBE = (
    '<texture name="cube" type="cube" builtin="gradient" rgb1=".9 .2 .1" rgb2=".1 .2 .9" width="64" height="384"/>'
    '<material name="cube" texture="cube"/>'
)
_PANEL = (
    '<mesh name="panel" vertex="-.08 -.06 0 .08 -.06 0 .08 .06 0 -.08 .06 0 0 0 -.05"'
    ' face="0 1 2 0 2 3 1 0 4 2 1 4 3 2 4 0 3 4" texcoord="0 0 1 0 1 1 0 1 .5 .5"/>'
)

SCENES: dict[str, str] = {
    "box": _one("box", ".04 .03 .02", ".9 .2 .1 1"),
    "sphere": _one("sphere", ".05", ".1 .6 .2 1"),
    "capsule": _one("capsule", ".025 .05", ".2 .3 .9 1"),
    "cylinder": _one("cylinder", ".04 .03", ".9 .7 .1 1"),
    "ellipsoid": _one("ellipsoid", ".06 .04 .02", ".6 .2 .7 1"),
    "plane": _scene(_FLOOR + _BRICK),
    "material": _scene(
        '<geom type="box" size=".03 .03 .03" pos="-.05 0 .03" material="red"/>'
        '<geom type="box" size=".03 .03 .03" pos=".05 0 .03" material="red" rgba=".1 .8 .3 1"/>',
        '<material name="red" rgba=".9 .1 .2 1"/>',
    ),
    "seen through": _scene(
        _BRICK + '<geom type="box" size=".06 .06 .06" pos="0 0 .05" rgba=".2 .4 .9 .3" contype="0" conaffinity="0"/>'
    ),
    "groups": _scene(
        _BRICK + '<geom type="sphere" size=".1" group="3"/><geom type="box" size=".02 .02 .02" pos=".08 0 .05" group="2"'
        ' rgba=".2 .7 .7 1"/>'
    ),
    "mesh": _scene(_FREE.format('<geom type="mesh" mesh="ring" rgba=".8 .5 .2 1" mass=".2"/>'), _RING),
    "mesh turned": _scene(
        _FREE.format('<geom type="mesh" mesh="ring" euler="60 20 0" rgba=".8 .5 .2 1" mass=".2"/>'), _RING
    ),
    "height field": _scene('<geom type="hfield" hfield="hill" rgba=".4 .6 .3 1"/>', _HILL),
    "sites": _scene(
        _BRICK + '<site type="box" size=".02 .01 .03" pos=".07 0 .05" rgba=".1 .8 .8 1"/>'
        '<site type="sphere" size=".02" pos="-.07 0 .05" rgba=".8 .1 .8 1"/><site size=".03" pos="0 .09 .05" group="4"/>'
    ),
    "tendon": _scene(_PULLED, more=_TENDON),
    "cloth": _scene(_CLOTH),
    "jelly": _scene(_JELLY),
    "rope": _scene(_ROPE),
    "texture on a floor": _scene(
        '<geom type="plane" size=".15 .12 .01" material="cross"/>' + _BRICK, _CROSS
    ),
    "textures": _scene(
        '<geom type="mesh" mesh="panel" material="check" pos="-.08 0 .05"/>'
        '<geom type="sphere" size=".04" material="cube" pos=".08 .06 .05"/>'
        '<geom type="box" size=".03 .03 .03" material="cube" pos="0 .08 .1"/>'
        '<geom type="cylinder" size=".02 .04" material="cube" pos="-.1 -.12 .05" euler="60 0 0"/>',
        _CHECKER + _CUBE + _PANEL,
    ),
    "mixed": _scene(
        '<geom type="hfield" hfield="hill" material="check" rgba=".4 .6 .3 1"/>'
        + _PULLED.replace('pos="-.1 0 .1"', 'pos="-.1 0 .12"')
        + '<body pos="0 .05 .12"><freejoint/><geom type="mesh" mesh="ring" material="cube" mass=".2"/></body>',
        _HILL + _RING + _CUBE + _CHECKER,
        _TENDON,
    ),
}  # fmt: skip
