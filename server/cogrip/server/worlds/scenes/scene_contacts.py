"""Contact forces at the tools of a scene, and slip, frame by frame; and the measures of a whole run.

Of tool i, over its (MOST_CONTACTS strongest) contacts c with other bodies, as they were solved in the last substep of a frame:

    N_i = sum of f_n,c        T_i = sum of |f_t,c|        f_n, f_t: normal and tangential force of a contact [N]

Slip s_i is how far the tool has moved along the surface of the body that it touches since they met: p is the mean of the points
where they met, kept in the tool's frame (p_t) and in the body's (p_b), n_b the normal there in the body's frame;
with x_t, R_t place and rotation of the tool and x_b, R_b of the body,

    d = R_b^T (x_t + R_t p_t - x_b) - p_b        s_i = |d - (d . n_b) n_b|

Forces are taken in every frame, slip, and lift and turn of the object in every fourth one: where a contact began since, they
have met there. It ends in the first frame without a force, and the slip is 0 again.
"""

from collections.abc import Sequence
from math import acos, degrees, hypot
from operator import mul, sub
from typing import Any, NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.machine.addition import add_floats
from cogrip.server.worlds.scenes.scene_file import MOST_CONTACTS, Scene
from cogrip.server.worlds.world import turn

LIFTED_M = 0.01  # height above its start from which on the object counts as lifted
SLIP_EVERY = 4  # number of frames from one measurement of slip and lift to the next; forces are read in every frame


class Touch(NamedTuple):
    """Sums of contact forces at a tool [N], and slip [m]."""

    normal_n: float = 0.0
    friction_n: float = 0.0
    slip_m: float = 0.0


class _Meeting(NamedTuple):
    """A contact that goes on: the body that is touched, and where they met: p_t, p_b and n_b."""

    body: int
    at_tool: list[float]
    at_body: list[float]
    normal: list[float]


_Poses = tuple[list[list[float]], list[list[float]]]  # place and rotation of every body
_NOTHING = Touch()
_SENSOR = 4 * MOST_CONTACTS
"""Numbers of a sensor, of each contact: how many there are, its normal and its tangential forces."""


class SceneContacts:
    """touches: of each seat's tool in the last frame. `read` stands between the forces of a substep and the next places."""

    def __init__(self, scene: Scene, frame_s: float) -> None:
        model = scene.model
        seats = {tool.body: seat for seat, tool in enumerate(scene.tools)}
        self._model, self._frame_s = model, frame_s
        self._bodies: list[int] = [
            *model.geom_bodyid.tolist(),
            0,
        ]  # of each geom; the last: -1, part of a flexible body
        self._seats = [seats.get(int(model.body_rootid[body]), -1) for body in self._bodies]
        self._tools = [tool.body for tool in scene.tools]
        self._force = np.zeros(6)
        self._sensors: list[int] = model.sensor_adr[-len(self._tools) :].tolist()
        self._object = scene.object
        self._peaks = [_NOTHING] * len(self._tools)
        self._frames = [0] * len(self._tools)  # in contact
        self._tied = [_is_tied(model, body) for body in self._tools]
        self._reads = 0
        self._lifted_m, self._lifted = 0.0, 0  # frames
        self._lifted_slip_m, self._at_lift = 0.0, [0.0] * len(self._tools)
        start = scene.start.data(model)
        self._height, self._turned = float(start.xpos[self._object, 2]), start.xmat[self._object].tolist()
        self._trace = 3.0  # least of that of the object's rotation from its start
        self.forget()

    def forget(self) -> None:
        """End all contacts: bodies were put somewhere by hand."""
        self.touches = [_NOTHING] * len(self._tools)
        self._meetings: list[_Meeting | None] = [None] * len(self._tools)

    def read(self, data: Any) -> None:
        """Take in the contacts of a frame, whose forces are known."""
        self._reads += 1
        measured: list[float] = data.sensordata.tolist()
        poses = (data.xpos.tolist(), data.xmat.tolist()) if self._reads % SLIP_EVERY == 0 else None
        for seat, first in enumerate(self._sensors):
            if measured[first + 1] > 0.0:  # the strongest
                self._touch(data, seat, measured[first : first + _SENSOR], poses)
            elif self.touches[seat] is not _NOTHING:
                self.touches[seat], self._meetings[seat] = _NOTHING, None
        if poses is not None and self._object >= 0:
            self._follow(poses[0][self._object][2] - self._height, poses[1][self._object])

    def _follow(self, height_m: float, turned: list[float]) -> None:
        """Take in how far the object is above its start, and its rotation."""
        self._lifted_m = max(self._lifted_m, height_m)
        self._trace = min(self._trace, add_floats(map(mul, turned, self._turned)))
        slips = [touch.slip_m for touch in self.touches]
        if height_m <= LIFTED_M:
            self._at_lift = slips
            return
        self._lifted += SLIP_EVERY
        self._at_lift = list(map(min, self._at_lift, slips))  # a contact may have begun anew
        self._lifted_slip_m = max(self._lifted_slip_m, *map(sub, slips, self._at_lift))

    def _touch(self, data: Any, seat: int, measured: list[float], poses: _Poses | None) -> None:
        normal, slip = add_floats(measured[1::4]), self.touches[seat].slip_m
        friction = add_floats(map(hypot, measured[2::4], measured[3::4]))
        meeting, tool = self._meetings[seat], self._tools[seat]
        if poses is not None:
            geoms = data.contact.geom.tolist()
            if meeting is None or not self._near(geoms, seat, meeting.body):
                slip, self._meetings[seat] = 0.0, self._meet(data, seat, geoms)
            else:
                (place, other), (turned, other_turned) = ([each[tool], each[meeting.body]] for each in poses)
                slip = _slip(place, turned, other, other_turned, meeting)
        self.touches[seat] = Touch(normal, friction, slip)
        peak = self._peaks[seat]
        if normal > peak.normal_n or friction > peak.friction_n or slip > peak.slip_m:
            self._peaks[seat] = Touch(*map(max, peak, self.touches[seat]))
        self._frames[seat] += 1

    def _near(self, geoms: list[list[int]], seat: int, body: int) -> bool:
        """Return whether a contact of this tool, with a force or without, is with this body."""
        seats, bodies = self._seats, self._bodies
        for one, other in geoms:
            if (seats[one] == seat and bodies[other] == body) or (seats[other] == seat and bodies[one] == body):
                return True
        return False

    def _meet(self, data: Any, seat: int, geoms: list[list[int]]) -> _Meeting:
        """Return where a tool meets the body of its strongest contact."""
        seats, bodies, tool = self._seats, self._bodies, self._tools[seat]
        found: list[tuple[float, int, int]] = []
        for number, (one, other) in enumerate(geoms):
            if seat in (seats[one], seats[other]):
                mujoco.mj_contactForce(self._model, data, number, self._force)
                found.append((float(self._force[0]), bodies[other if seats[one] == seat else one], number))
        _, body, strongest = max(found)
        numbers = [number for push, each, number in found if each == body and push > 0.0]
        at = data.contact.pos[numbers].mean(axis=0)
        of_tool, of_body = data.xmat[tool].reshape(3, 3).T, data.xmat[body].reshape(3, 3).T
        return _Meeting(
            body,
            turn(of_tool, at - data.xpos[tool]).tolist(),
            turn(of_body, at - data.xpos[body]).tolist(),
            turn(of_body, data.contact.frame[strongest, :3]).tolist(),
        )

    def save(self) -> tuple[float, ...]:
        """Return the measures of the run so far."""
        tools = [
            float(each) for peak, frames in zip(self._peaks, self._frames, strict=True) for each in (*peak, frames)
        ]
        return (self._lifted_m, float(self._lifted), self._lifted_slip_m, self._trace, *tools)

    def restore(self, saved: Sequence[float]) -> None:
        """Go on from there. Contacts begin anew, as all who held on do."""
        self._lifted_m, lifted, self._lifted_slip_m, self._trace = saved[:4]
        self._lifted = int(lifted)
        for seat in range(len(self._tools)):
            *peak, frames = saved[4 + 4 * seat : 8 + 4 * seat]
            self._peaks[seat], self._frames[seat] = Touch(*peak), int(frames)
        self.forget()

    def account(self, users: Sequence[str]) -> dict[str, Any]:
        """Return the measures of the run so far; of the object None where there is none."""
        tools = [
            {"name": name, "peak_normal_n": peak.normal_n, "peak_friction_n": peak.friction_n, "slip_m": peak.slip_m,
             "contact_s": frames * self._frame_s, "tied": tied}
            for name, peak, frames, tied in zip(users, self._peaks, self._frames, self._tied, strict=True)
        ]  # fmt: skip
        free = self._object >= 0
        cosine = min(1.0, max(-1.0, 0.5 * (self._trace - 1.0)))  # of the angle
        return {
            "peak_contact_n": max([peak.normal_n for peak in self._peaks]),
            "slip_m": max([peak.slip_m for peak in self._peaks]),
            "lifted_m": self._lifted_m if free else None,
            "lifted_s": self._lifted * self._frame_s if free else None,
            "lifted_slip_m": self._lifted_slip_m if free else None,
            "turned_deg": degrees(acos(cosine)) if free else None,
            "tools": tools,
        }


def _is_tied(model: mujoco.MjModel, body: int) -> bool:
    """Return whether a tool holds something without contact: by an equality, or as other bodies hang on it or it on them."""
    root = model.body_rootid[body]
    ends = [
        *model.eq_obj1id[model.eq_objtype == mujoco.mjtObj.mjOBJ_BODY],
        *model.eq_obj2id[model.eq_objtype == mujoco.mjtObj.mjOBJ_BODY],
    ]
    alone = int((model.body_rootid == root).sum()) == 1
    return not alone or any(model.body_rootid[end] == root for end in ends if end > 0)


def _slip(tool: list[float], turned: list[float], body: list[float], body_turned: list[float], met: _Meeting) -> float:
    """Return s [m]."""
    a, b, c, d, e, f, g, h, i = turned
    px, py, pz = met.at_tool
    x = tool[0] + a * px + b * py + c * pz - body[0]
    y = tool[1] + d * px + e * py + f * pz - body[1]
    z = tool[2] + g * px + h * py + i * pz - body[2]
    a, b, c, d, e, f, g, h, i = body_turned
    qx, qy, qz = met.at_body
    nx, ny, nz = met.normal
    dx, dy, dz = a * x + d * y + g * z - qx, b * x + e * y + h * z - qy, c * x + f * y + i * z - qz
    along = dx * nx + dy * ny + dz * nz
    return hypot(dx - along * nx, dy - along * ny, dz - along * nz)
