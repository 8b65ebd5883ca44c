"""A client's own copy of a scene: one free body, the object, what is fixed, and a tool of each person (theory 5b.3).

It is made of the numbers that the server tells, never of a file: primitive shapes, friction, masses. MuJoCo steps it at each
tick. One's own tool hangs on a spring to one's own hand, a partner's on the model of that hand. Places are in the hand's own
frame; the whole copy lies `shift_m` from there, as far as the gate has moved it, and comes back with SHIFTED_S.

The server owns the object. Of o, R its place and turn here, o^, R^ as told and gone on with its velocity until now:

    torque     I (w^2 e - 2 w R')         e: rotation from R to R^, MOST_TURN at most; always
    place      o moves by (o^ - o) T / DRAWN_S while no tool touches it here; else by what is beyond LOST_M alone

What tools hold is where they hold it, and slips if it is drawn. It is turned, as hands that are told late tilt what they lift:
not where tools turn (theory 5b.4), as those hold it against that, and then only by what is beyond LOST_RAD.
"""

from collections.abc import Mapping, Sequence
from math import dist

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.drawing import MOST_COPIED, OBJECT_NUMBERS, TURNING_NUMBERS, WELDED_NUMBERS, Shape
from cogrip.protocol.laws.partner_model import HORIZON_S, Model, ToolDrive, ahead
from cogrip.protocol.laws.poses import IN_PLACES, Places, Poses
from cogrip.protocol.laws.rotations import UNTURNED, exp, inverse, log, turned
from cogrip.protocol.laws.scene_contact import GEOM, IMPRATIO, WELD
from cogrip.protocol.settings.types import MOST_PARTNERS

SHIFTED_S = 0.1
DRAWN_S = 0.1
LOST_M = 0.05
TURNED_PS = 200.0  # w
LOST_RAD = 0.3
MOST_TURN = 0.05  # largest e [rad]: hands that mean to turn it feel so much torque, until the server has it turned
LOOKED_TICKS = 8  # ticks after which it is looked again which tools touch the object, and which may
CLEAR_M, GAP_M = 0.0005, 0.1  # distance that a tool keeps as it comes, and the largest one that is measured
MOST_MOVES = 20  # most moves until it does
MOST_RATE = 1e5  # largest rate of anything [m/s, rad/s], as at the server
_KINDS = {
    "plane": mujoco.mjtGeom.mjGEOM_PLANE, "box": mujoco.mjtGeom.mjGEOM_BOX, "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE, "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}  # fmt: skip


class CopyError(ValueError):
    """Shapes of which no copy can be made, or a copy that has left all bounds. The text says why."""


class _Tool:
    """A tool of the copy.

    solid   it touches what it meets
    held    by a hand, or the model of one
    turns   with its hand: it has the degrees of freedom `turning` and a quaternion
    carried part of its weight that is carried while it is held
    welded  where it is on the object, in the object's frame [m]; None for one that holds by contact
    """

    def __init__(self, model: mujoco.MjModel, body: int) -> None:
        joint = int(model.body_jntadr[body])
        first, at = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
        self.dofs, self.turning = slice(first, first + PLACES), slice(first + PLACES, first + POSE_AXES)
        self.places, self.quaternion = slice(at, at + PLACES), slice(at + PLACES, at + PLACES + 4)
        self.body, self.carried = body, float(model.body_gravcomp[body])
        self.turns = int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_FREE)
        self.welded: list[float] | None = model.body_pos[body].tolist() if body in model.eq_obj2id else None
        self.geoms = np.flatnonzero(model.geom_bodyid == body)
        self.bits = model.geom_contype[self.geoms].copy(), model.geom_conaffinity[self.geoms].copy()
        self.solid = self.held = False


class SceneCopy:
    """space: of the rows of hands, tools and models. Raises CopyError."""

    def __init__(self, shapes: Sequence[Shape], seat: int, tick_s: float, space: Places = IN_PLACES) -> None:
        self._seat, self._tick_s, self._space = seat, tick_s, space
        self._length_m = space.length_m if isinstance(space, Poses) else 0.0
        self._model = model = _compiled(shapes, tick_s)
        self._data = data = mujoco.MjData(model)
        self._object = model.body("object").id
        seats = sorted({shape.seat for shape in shapes if shape.seat is not None})
        self._tools = {each: _Tool(model, model.body(f"tool {each}").id) for each in seats}
        if seat not in self._tools:
            raise CopyError("it has no tool for this seat")
        if any(tool.turns != bool(self._length_m) for tool in self._tools.values()):
            raise CopyError("its tools turn where hands don't, or the other way round")
        self._welded = [(tool, at) for tool in self._tools.values() if (at := tool.welded) is not None]
        joint = int(model.body_jntadr[self._object])
        first, self._dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        self._place, self._turn = slice(first, first + 3), slice(first + 3, first + 7)
        self._inertia = model.body_inertia[self._object].copy()
        self.shift_m = np.zeros(POSE_AXES if self._length_m else PLACES)
        self._aim: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # place, velocity, orientation, as of now
        self._left_s = 0.0  # for which it goes on by its velocity
        self._tick = 0
        self._touched = False  # the object, by a tool
        for tool in self._tools.values():
            self._let_go(tool)
        mujoco.mj_kinematics(model, data)

    @property
    def place_m(self) -> list[float]:
        """Place of one's own tool, where the gate has moved it to."""
        return self._space.moved(self._at(self._tools[self._seat]), self.shift_m.tolist())

    @property
    def velocity_mps(self) -> list[float]:
        """Velocity of one's own tool."""
        return self._rates(self._tools[self._seat])

    @property
    def object_m(self) -> Row:
        """Place of the object in the copy, wherever the gate has moved that."""
        return tuple(self._data.qpos[self._place].tolist())

    @property
    def object_pose(self) -> tuple[float, float, float, tuple[float, ...]]:
        """Place of the object in the copy, and its quaternion."""
        x, y, z = self.object_m
        return x, y, z, tuple(self._data.qpos[self._turn].tolist())

    def tool_places(self) -> dict[int, Row]:
        """Return the place of each seat's tool in the copy."""
        return {seat: tuple(self._data.qpos[tool.places].tolist()) for seat, tool in self._tools.items()}

    @property
    def placed(self) -> bool:
        """Return whether it is known where the object is."""
        return self._aim is not None

    def move(self, way_m: Sequence[float]) -> None:
        """Move the whole copy; it comes back with SHIFTED_S."""
        self.shift_m += way_m

    def tell(
        self, place_m: Sequence[float], velocity_mps: Sequence[float], orientation: Sequence[float], age_s: float = 0.0
    ) -> None:
        """Take in where the server had the object so long ago: it goes on by its velocity, as far as the horizon.

        The first time it is put there.
        """
        known = self._aim is not None
        self._aim = np.array(ahead(place_m, velocity_mps, age_s)), np.array(velocity_mps), np.array(orientation)
        self._left_s = HORIZON_S - age_s
        if not known:
            self._put()

    def begin(self, position_m: Sequence[float]) -> None:
        """Begin with one's own tool in the hand, at rest, and the object where the server has it."""
        self.shift_m[:] = 0.0
        for tool in self._tools.values():
            self._let_go(tool)
        if self._aim is not None:
            self._put()
        self._take(self._tools[self._seat], position_m)

    def step(
        self, position_m: Sequence[float], velocity_mps: Sequence[float], spring: tuple[float, float],
        models: Mapping[int, Model],
    ) -> None:  # fmt: skip
        """Step by a tick: hand, and models of the partners who hold, by seat. Raises CopyError beyond all bounds."""
        data, T = self._data, self._tick_s
        drives = []
        for seat, tool in self._tools.items():
            if seat == self._seat:
                self._hold(tool, position_m, velocity_mps, spring)
            elif (model := models.get(seat)) is None:
                if tool.held:
                    self._let_go(tool)
            else:
                if not tool.held:
                    model.place_m = self._enter(tool, model.place_m)
                drive = ToolDrive(T, spring, model, self._at(tool))
                self._drive(tool, drive.force_n, drive.damping_nspm)
                drives.append((drive, tool))
        self._draw()
        mujoco.mj_step1(self._model, data)
        if self._tick % LOOKED_TICKS == 0:
            self._look()
        self._tick += 1
        data.efc_margin[:] = 0.0
        mujoco.mj_step2(self._model, data)
        rates = data.qvel
        if not float(np.add.reduce(rates * rates)) < MOST_RATE**2:
            mujoco.mj_resetData(self._model, data)
            raise CopyError("it left all bounds")
        for drive, tool in drives:
            drive.end(self._rates(tool))

    def _hold(
        self, tool: _Tool, position_m: Sequence[float], velocity_mps: Sequence[float], spring: tuple[float, float]
    ) -> None:
        """Hold one's own tool by its spring, implicit in the tool's motion."""
        K, B = spring
        self.shift_m *= 1.0 - self._tick_s / SHIFTED_S
        space = self._space
        stretch = space.way(self._at(tool), space.moved(position_m, (-self.shift_m).tolist()))
        force = [K * s + B * v for s, v in zip(stretch, velocity_mps, strict=True)]
        self._drive(tool, force, K * self._tick_s + B)

    def _at(self, tool: _Tool) -> list[float]:
        """Return place or pose of a tool."""
        place: list[float] = self._data.qpos[tool.places].tolist()
        if tool.turns:
            place += [self._length_m * each for each in log(self._data.qpos[tool.quaternion].tolist())]
        return place

    def _rates(self, tool: _Tool) -> list[float]:
        """Return its velocity, shape (axes,)."""
        rates: list[float] = self._data.qvel[tool.dofs].tolist()
        if tool.turns:  # MuJoCo has them in the tool's own frame
            own = self._data.qvel[tool.turning].tolist()
            rates += [self._length_m * each for each in turned(self._data.qpos[tool.quaternion].tolist(), own)]
        return rates

    def _drive(self, tool: _Tool, force_n: Sequence[float], damping_nspm: float) -> None:
        """Hold a tool by a force, shape (axes,), beside a damper to ground."""
        applied, damping, length = self._data.qfrc_applied, self._model.dof_damping, self._length_m
        applied[tool.dofs], damping[tool.dofs] = force_n[:PLACES], damping_nspm
        if tool.turns:
            back = inverse(self._data.qpos[tool.quaternion].tolist())
            applied[tool.turning] = turned(back, [length * each for each in force_n[PLACES:]])
            damping[tool.turning] = length * length * damping_nspm

    def _put(self) -> None:
        """Put the object where the server has it."""
        assert self._aim is not None
        data = self._data
        data.qpos[self._place], data.qvel[self._dof : self._dof + 3], data.qpos[self._turn] = self._aim
        data.qvel[self._dof + 3 : self._dof + 6] = 0.0
        self._carry()

    def _carry(self) -> None:
        """Put what is welded to the object where that has it."""
        data, turn = self._data, self._data.qpos[self._turn]
        for tool, at in self._welded:
            data.qpos[tool.places] = data.qpos[self._place] + turned(turn.tolist(), at)
            data.qpos[tool.quaternion] = turn
            data.qvel[tool.dofs], data.qvel[tool.turning] = data.qvel[self._dof : self._dof + 3], 0.0

    def _draw(self) -> None:
        """Draw the object to where the server has it."""
        if self._aim is None:
            return
        data, T = self._data, self._tick_s
        place, velocity, orientation = self._aim
        if self._left_s > 0.0:
            self._left_s -= T
            self._aim = place + T * velocity, velocity, orientation
        turn, rates = np.zeros(3), data.qvel[self._dof + 3 : self._dof + 6]
        mujoco.mju_subQuat(turn, orientation, data.qpos[self._turn])  # in the object's own frame
        angle = float(np.sqrt(np.add.reduce(turn * turn)))
        if angle > MOST_TURN:
            turn *= MOST_TURN / angle
        torque = self._inertia * TURNED_PS * (TURNED_PS * turn - 2.0 * rates)
        if self._length_m and self._touched and angle < LOST_RAD:
            torque[:] = 0.0
        data.qfrc_applied[self._dof + 3 : self._dof + 6] = torque
        off = place - data.qpos[self._place]
        far = float(np.sqrt(np.add.reduce(off * off)))
        free = LOST_M if self._touched else 0.0
        if far > free:
            way = (1.0 - free / far) * T / DRAWN_S * off
            data.qpos[self._place] += way
            for tool, _ in self._welded:
                data.qpos[tool.places] += way

    # Tools

    def _take(self, tool: _Tool, place_m: Sequence[float]) -> None:
        """Put a tool into a hand; one that is welded stays where it is."""
        tool.held = True
        self._model.body_gravcomp[tool.body] = tool.carried
        if tool.welded is not None:
            return
        self._data.qpos[tool.places], self._data.qvel[tool.dofs] = place_m[:PLACES], 0.0
        if isinstance(self._space, Poses):
            self._data.qpos[tool.quaternion] = exp(self._space.radians(place_m))
            self._data.qvel[tool.turning] = 0.0

    def _let_go(self, tool: _Tool) -> None:
        """Leave a tool where it is, touching nothing; one that is welded stays on the object."""
        self._drive(tool, [0.0] * len(self.shift_m), 0.0)
        if tool.welded is None:
            self._model.body_gravcomp[tool.body] = 1.0
            self._data.qvel[tool.dofs] = 0.0
            if tool.turns:
                self._data.qvel[tool.turning] = 0.0
        tool.held = False
        self._touch(tool, False)

    def _touch(self, tool: _Tool, solid: bool) -> None:
        contype, conaffinity = tool.bits
        self._model.geom_contype[tool.geoms] = contype if solid else 0
        self._model.geom_conaffinity[tool.geoms] = conaffinity if solid else 0
        tool.solid = solid

    def _look(self) -> None:
        """Let tools touch that are held and inside of nothing, and see whether one touches the object."""
        model, data = self._model, self._data
        contact = data.contact
        pairs, depths = contact.geom, contact.dist
        of_object = model.geom_bodyid[pairs] == self._object
        by_tool = np.isin(pairs, np.concatenate([tool.geoms for tool in self._tools.values()]))
        touched = bool(np.any(of_object.any(axis=1) & by_tool.any(axis=1) & (depths < 0.0)))
        self._touched = touched or any(tool.held for tool, _ in self._welded)
        for tool in self._tools.values():
            if tool.held and not tool.solid and self._gap(tool) >= 0.0:
                self._touch(tool, True)

    def _gap(self, tool: _Tool) -> float:
        """Return the distance of a tool from what it would touch [m], at most GAP_M; below 0 inside of something."""
        model, mine, least = self._model, set(tool.geoms.tolist()), GAP_M
        for geom, contype, conaffinity in zip(tool.geoms.tolist(), *tool.bits, strict=True):
            for other in range(model.ngeom):
                touches = int(contype) & int(model.geom_conaffinity[other]) | int(conaffinity) & int(
                    model.geom_contype[other]
                )
                if touches and other not in mine:
                    least = min(least, mujoco.mj_geomDistance(model, self._data, geom, other, GAP_M, None))
        return least

    def _enter(self, tool: _Tool, place_m: Sequence[float]) -> list[float]:
        """Take a partner's tool, as far out from the object's middle as it is free. Return where.

        A hand that presses means to be inside of the object: its tool would touch nothing there.
        """
        if tool.welded is not None:
            self._take(tool, place_m)
            return self._at(tool)
        place, middle, turn = np.array(place_m[:PLACES]), self._data.qpos[self._place], place_m[PLACES:]
        way = place - middle
        far = float(np.sqrt(np.add.reduce(way * way)))
        way = way / far if far else np.array((0.0, 0.0, 1.0))
        for _ in range(MOST_MOVES):
            self._take(tool, (*place.tolist(), *turn))
            mujoco.mj_kinematics(self._model, self._data)
            gap = self._gap(tool)
            if gap >= 0.0:
                break
            place += (CLEAR_M - gap) * way
        return [*place.tolist(), *turn]


def _compiled(shapes: Sequence[Shape], tick_s: float) -> mujoco.MjModel:
    """Return the model of these shapes. Raises CopyError."""
    if len(shapes) > MOST_COPIED or not any(shape.object for shape in shapes):
        raise CopyError("it has too many shapes, or no object")
    mujoco.set_mju_user_warning(_unsaid)
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep, option.impratio = tick_s, IMPRATIO
    option.integrator, option.cone = mujoco.mjtIntegrator.mjINT_DISCRETE, mujoco.mjtCone.mjCONE_ELLIPTIC
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    bodies: dict[str, mujoco.MjsBody] = {}
    for shape in shapes:
        solid = shape.solid
        if not solid or shape.kind not in _KINDS or (shape.seat is not None and shape.seat > MOST_PARTNERS):
            raise CopyError("it has a shape that is none of a copy")
        name = "object" if shape.object else "" if shape.seat is None else f"tool {shape.seat}"
        body = bodies.get(name) or spec.worldbody
        if name and name not in bodies:
            body = bodies[name] = spec.worldbody.add_body(name=name, explicitinertial=True)
            if shape.object:
                _weigh_object(option, body, solid.inertia)
            elif len(solid.inertia) > 1:
                _weigh_turning(spec, body, solid.inertia)
            else:
                _weigh_tool(body, solid.inertia)
        geom = body.add_geom(
            type=_KINDS[shape.kind], size=shape.size_m, pos=shape.place_m, quat=shape.orientation,
            friction=solid.friction, contype=solid.bits[0], conaffinity=solid.bits[1], mass=0.0,
        )  # fmt: skip
        for key, value in GEOM.items():
            setattr(geom, key, value)
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        raise CopyError(str(error)) from None


def _unsaid(text: str) -> None:
    """Do nothing: MuJoCo would write its warnings to a file here."""


def _weigh_object(option: mujoco.MjOption, body: mujoco.MjsBody, inertia: Sequence[float]) -> None:
    if len(inertia) != OBJECT_NUMBERS or not dist(inertia[7:11], (0.0,) * 4) > 0.0:
        raise CopyError("its object has no inertia")
    body.add_freejoint()
    body.mass, body.ipos, body.inertia, body.iquat = inertia[0], inertia[1:4], inertia[4:7], inertia[7:11]
    option.gravity = inertia[11:]


def _weigh_tool(body: mujoco.MjsBody, inertia: Sequence[float]) -> None:
    """Give a tool its mass, and no weight. It does not turn, so that its moments are nobody's."""
    if len(inertia) != 1:
        raise CopyError("a tool has no mass")
    for axis in np.eye(3):
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    body.gravcomp, body.mass, body.inertia = 1.0, inertia[0], np.full(3, 1e-4 * inertia[0])


def _weigh_turning(spec: mujoco.MjSpec, body: mujoco.MjsBody, inertia: Sequence[float]) -> None:
    """Give a tool that turns its mass and moments, and the weld by which it holds the object, if any."""
    if len(inertia) not in (TURNING_NUMBERS, WELDED_NUMBERS) or not dist(inertia[7:11], (0.0,) * 4) > 0.0:
        raise CopyError("a tool that turns has no moments")
    body.add_freejoint()
    body.gravcomp, body.mass = inertia[11], inertia[0]
    body.ipos, body.inertia, body.iquat = inertia[1:4], inertia[4:7], inertia[7:11]
    if len(inertia) == WELDED_NUMBERS:
        body.pos = inertia[TURNING_NUMBERS:]
        weld = spec.add_equality(
            type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1="object", name2=body.name
        )
        # Anchor, place and orientation in the object, and the part of a torque beside a force.
        weld.data[:11] = 0.0, 0.0, 0.0, *inertia[TURNING_NUMBERS:], *UNTURNED, 1.0
        for key, value in WELD.items():
            setattr(weld, key, value)
