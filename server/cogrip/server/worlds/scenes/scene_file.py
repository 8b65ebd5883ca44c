"""Scenes of rigid bodies from MJCF or URDF: read, checked, given contact that creates no energy and a tool for each seat.

MuJoCo's contact creates energy as it comes: at impedance d near 1 a new contact brings many times the tool's mass with it. With

    solimp = d d w .5 2      solref = -kappa (1 - d), -beta (1 - d)      d = 0.1, kappa = 4e5 1/s^2, beta = 1300 1/s

each contact is a spring K = kappa M beside a damper B = beta M, M the mass that it meets (of a tool of mass m at a port of
impedance b, against a fixed body: m + h b, step h). What is held by friction creeps, a box of 0.2 kg between two hands by
1.2 mm a minute at impratio 100, by 0.04 mm at 3000. A scene that sets such values itself keeps them (`Scene.own`). It does not
choose how a step is solved (`Scene.changed`): with other integrators, or a solver that stops early, a box at rest is thrown up.
"""

import warnings
from collections.abc import Callable, Collection, Sequence, Set
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.machine.addition import add_integers
from cogrip.machine.trial import MEMORY_BYTES, TrialLimitError, tried
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.laws.scene_contact import GEOM, IMPRATIO, WELD
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.types import PINCH, Orientation, Side
from cogrip.protocol.texts import shown
from cogrip.server.worlds.scenes.scene_places import CLEAR_M, SITE, Placed, place_tools
from cogrip.server.worlds.scenes.scene_start import Start, names_of, start_of
from cogrip.server.worlds.scenes.scene_text import (
    MOST_NAMED,
    OutsideError,
    SceneError,
    SceneFiles,
    listed,
    read_scene,
    scene_of,
)

MOST_CONTACTS = 8  # most contacts of a tool whose forces are measured, the strongest ones
MOST_ITERATIONS = 1000
"""Most iterations of a solver in a step, and of its starting points: what does not converge goes on for ever."""
DIGEST_DIGITS = 16
TRIED_STEPS = 20  # number of steps in the child process in which a scene is tried
MANY_DOFS = 200  # degrees of freedom from which on contacts get MANY_BYTES of memory at least
MANY_BYTES = 2**27
MOST_RESERVED = 2000  # most contacts, or rows of constraints, for which a scene reserves memory
MOST_RATE = 1e5  # largest rate of anything after one step [m/s, rad/s]
MOST_FAR_M = 1e4  # largest distance of a body from the middle, and of a geom from its body
TOOLS = ("pad", "ball", "box", PINCH)
"""Tools that are added; `tool = ""` is the first."""
TOOL_KG = 0.05
ADDED = "tool of seat "  # beginning of the name of an added body; the number of its seat follows
MOCAP_M = 0.01  # radius of the ball whose inertia a mocap body has as a tool
APART_M = 0.05  # distance between added tools of one side
FINGER_M, FINGER_APART_M = 0.004, 0.006
"""Radius of the balls of a gripper's faces, and their distance from the middle of each face along its sides."""

_LIMIT = {"solimp_limit": GEOM["solimp"], "solref_limit": GEOM["solref"], "margin": GEOM["margin"]}
"""Limits of joints and tendons at the ends of their ranges. A hinge's margin is in radians."""
STICTION_SHARE = 0.9999
"""Value d of joints with dry friction (solimp): at MuJoCo's usual 0.9 they creep by what the friction should hold."""
_SOLVED: dict[str, Callable[[Any], Any]] = {
    "integrator": lambda given: mujoco.mjtIntegrator.mjINT_DISCRETE,
    "solver": lambda given: mujoco.mjtSolver.mjSOL_NEWTON,
    "iterations": lambda given: max(100, given),
    "ls_iterations": lambda given: max(50, given),
    "tolerance": lambda given: min(1e-8, given),
    "ls_tolerance": lambda given: min(0.01, given),
    "noslip_iterations": lambda given: 0,
}
"""Options of a step, each from what the scene gives: the energy law of ports and contacts holds with these."""
_OPTION = {
    "cone": mujoco.mjtCone.mjCONE_ELLIPTIC,
    "impratio": IMPRATIO,
    "jacobian": mujoco.mjtJacobian.mjJAC_DENSE,
}
SPARSE_FROM = 32
"""Degrees of freedom from which on matrices are sparse: a larger scene's solver is faster with them, a smaller one's is
slower."""
MOST_TRIED_GEOMS = 16
"""Most geoms of a body in such a scene with which each is tried with each: that is faster than to search trees of them."""
_OF_GEOMS = (
    "adhesion", "conaffinity", "condim", "contype", "density", "fluid_coefs", "fluid_ellipsoid", "friction", "gap", "group",
    "margin", "material", "priority", "rgba", "solimp", "solmix", "solref", "surfacevel",
)  # fmt: skip
_OF_JOINTS = (
    "actfrclimited", "actfrcrange", "actgravcomp", "align", "armature", "damping", "frictionloss", "group", "limited", "margin",
    "pos", "range", "ref", "solimp_friction", "solimp_limit", "solref_friction", "solref_limit", "springdamper", "springref",
    "springyield", "stiffness",
)  # fmt: skip
"""Attributes of an added tool that a scene's default classes are not to choose: it has MuJoCo's own."""
_SLIDES = [mujoco.mjtJoint.mjJNT_SLIDE] * 3
_FREE = [mujoco.mjtJoint.mjJNT_FREE]


@dataclass(frozen=True, slots=True)
class Tool:
    """A body that a seat's port moves.

    dof, coordinate  first of its three, and of six where it turns
    turns            it has a free joint
    orientation      of the seat's settings, "" for what its joints have
    opening          joint by which its finger slides away from it; -1 where it is no gripper
    """

    body: int
    dof: int
    coordinate: int
    turns: bool
    orientation: Orientation
    opening: int = -1

    @property
    def dofs(self) -> int:
        """Return the number of its degrees of freedom."""
        return POSE_AXES if self.turns else PLACES

    @property
    def driven(self) -> bool:
        """Return whether the port turns it, too."""
        return self.orientation == "driven"


@dataclass(frozen=True, slots=True)
class Scene:
    """A compiled scene.

    start   where its own bodies begin, and what its actuators do
    tools   one for each seat
    digest  of its files, tools and start
    object  body whose motion is that of the room's object: the first free one that is no tool; -1: there is none
    filled  contact settings that were applied, as the scene sets none
    own     those that the scene sets itself: what they do about energy is theirs
    changed those that the scene sets, and that do not hold: with what it sets, and what was taken
    sensors a name for each number of the scene's own, which come before those of its tools
    unused  what the scene has and nothing of a room uses, each with what would use it
    """

    model: mujoco.MjModel
    start: Start
    tools: tuple[Tool, ...]
    object: int
    filled: tuple[str, ...]
    own: tuple[str, ...]
    changed: tuple[str, ...]
    unused: tuple[str, ...]
    sensors: tuple[str, ...]
    digest: str


class SceneAccount(NamedTuple):
    """Account of a scene as its author has it, each part in words.

    refused: why it cannot be used, "" where it can; folder: one that would have all files that its texts name, "" for none
    """

    refused: str = ""
    added: tuple[str, ...] = ()
    filled: tuple[str, ...] = ()
    own: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    folder: str = ""


class Held(NamedTuple):
    """Choice of a seat's tool: name of its body or "", side on which it starts, orientation; grips: it has a finger.

    user: name of its person, for whom a site of the scene may name a place (`SITE`)
    """

    tool: str
    side: Side
    orientation: Orientation
    grips: bool = False
    user: str = ""


def held_by(settings: Settings) -> list[Held]:
    """Return what each seat asks for. In a room of poses a hand drives the orientation, if nothing else is said."""
    usual: Orientation = "driven" if settings.object.axes == POSE_AXES else ""
    return [
        Held(user.tool.removeprefix(f"{PINCH}:"), user.side, user.orientation or usual, user.grips, user.name)
        for user in settings.users
    ]


def scene_of_settings(settings: Settings, frame_s: float, script: str = "") -> Scene:
    """Return the scene of a room. script: what says which code its script is. Raises SceneError."""
    given = settings.object
    folder = Path(given.folder) if given.folder else None
    files = read_scene(Path(given.file), folder)
    made = _made(files, held_by(settings), frame_s / given.substeps, given.keyframe, given.ctrl)
    if not given.script:
        return made
    digest = sha256(f"{made.digest} {script}".encode()).hexdigest()[:DIGEST_DIGITS]
    return replace(made, digest=digest, unused=tuple(each for each in made.unused if not each.startswith(SCRIPTED)))


def account_of(settings: Settings, frame_s: float) -> SceneAccount:
    """Return what is added to a scene, set, changed and not used, or why it is refused."""
    try:
        scene = scene_of_settings(settings, frame_s)
    except SceneError as error:
        return SceneAccount(str(error), folder=error.folder if isinstance(error, OutsideError) else "")
    places = scene.start.data(scene.model).xpos
    added = [
        f"{user.tool or TOOLS[0]} for {user.name} at {', '.join(f'{1e3 * each:.4g}' for each in places[tool.body])} mm"
        for user, tool in zip(settings.users, scene.tools, strict=True)
        if scene.model.body(tool.body).name.startswith(ADDED)
    ]
    return SceneAccount("", tuple(added), scene.filled, scene.own, scene.changed, scene.unused)


def load_scene(
    path: Path, seats: Sequence[Held], step_s: float, folder: Path | None = None, keyframe: str = "",
    ctrl: Sequence[float] = (),
) -> Scene:  # fmt: skip
    """Return the scene of a file for these seats. Raises SceneError.

    folder: of its files, None for its own; keyframe, ctrl: as [object] of the settings has them
    """
    return _made(read_scene(path, folder), seats, step_s, keyframe, ctrl)


def make_scene(text: str, seats: Sequence[Held], step_s: float, name: str = "scene") -> Scene:
    """Return the scene of an XML text, which names no files. step_s: of one substep; name: for errors. Raises SceneError."""
    return _made(scene_of(text, name), seats, step_s)


def _made(
    files: SceneFiles, seats: Sequence[Held], step_s: float, keyframe: str = "", ctrl: Sequence[float] = ()
) -> Scene:
    """Return the scene. It is loaded and stepped in a child process first, under limits, once here for each text."""
    digest = _digest(files, seats, step_s, keyframe, ctrl)
    load = partial(_load, files, tuple(seats), step_s, keyframe, tuple(ctrl), digest[:DIGEST_DIGITS])
    if digest not in _tried:
        try:
            refusal = tried(partial(_refusal, load, files))
        except TrialLimitError as error:
            raise SceneError(f"{files.name}: {error}; make it smaller") from None
        if refusal:
            raise SceneError(refusal)
        _tried.add(digest)
    return load()


SCRIPTED = ("mocap bodies", "ctrl of actuators")
"""Beginning of the words in `Scene.unused` that a script of the scene uses after all."""

_tried: set[str] = set()
"""Whole digests of scenes that passed their trial in this process."""


def _refusal(load: Callable[[], Scene], files: SceneFiles) -> str:
    """Return why a scene cannot be used, "" where it can: it loads, and its first steps stay within bounds."""
    try:
        _try_steps(load(), files.name)
    except SceneError as error:
        return str(error)
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        return str(_unloadable(error, files))
    return ""


def _load(
    files: SceneFiles, seats: Sequence[Held], step_s: float, keyframe: str, ctrl: Sequence[float], digest: str
) -> Scene:
    """Return the scene, from arguments that can be pickled. Raises SceneError, whatever MuJoCo makes of the text."""
    mujoco.set_mju_user_warning(_counted)
    name, options = files.name, files.options
    try:
        spec, vfs = _parsed(files)
        spec.compiler.usethread = False  # each thread would take memory of its own
        sizes = _suit_memory(spec)
        bare = _compile(spec, vfs)
        if bare.nv >= MANY_DOFS and bare.narena < MANY_BYTES:
            spec.memory = MANY_BYTES  # contacts are found farther away than by MuJoCo alone
        begun = start_of(bare, keyframe, ctrl, name)
        for key in list(spec.keys):
            spec.delete(key)  # whose sizes would not be those of the scene with its tools
        _free_masses(spec)
        changed = (*sizes, *_solved(spec, options, step_s), *_suit_flexes(spec, name))
        filled, own = _complete(spec, options, step_s)
        if bare.nv >= SPARSE_FROM and "jacobian" not in options:
            spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        chosen = _choose_tools(spec, bare, begun, seats, name)
        for body in chosen:
            _add_sensor(spec, body)
        model = _compiled(spec, vfs, chosen)
        ids = [model.body(body).id for body in chosen]
        taken = {body for body in ids if body < bare.nbody and bare.body_mocapid[body] >= 0}
        if _weigh(spec, model, bare, taken):
            model = _compiled(spec, vfs, chosen)
        start = start_of(bare, keyframe, ctrl, name, model, {*taken, *range(bare.nbody, model.nbody)})
        sites = {model.site(site).name: site for site in range(model.nsite)}
        added = [
            Placed(body, held.side, sites.get(f"{SITE}{held.user}", -1))
            for body, held in zip(ids, seats, strict=True)
            if body >= bare.nbody
        ]
        place_tools(model, start, added, _first_free(model, set(ids)), name)
        if "jacobian" not in options:
            _suit_crowd(model)
    except SceneError:
        raise
    except Exception as error:  # noqa: BLE001 - MuJoCo raises RuntimeError and others for texts that it did not foresee
        raise _unloadable(error, files) from None
    _refuse_endless(model, name)
    if np.any(model.actuator_plugin >= 0) or np.any(model.body_plugin >= 0):
        raise SceneError(f"{name}: has plugins of actuators or bodies, whose energy is not counted; leave them out")
    tools = tuple(_tool(model, body, held, name) for body, held in zip(chosen, seats, strict=True))
    if len({tool.body for tool in tools}) < len(tools):
        twice = next(body for body in chosen if chosen.count(body) > 1)
        raise SceneError(f"{name}: two seats have the tool {twice!r}; name a body for each, or leave one out")
    unused = _unused(files, bare, taken, bool(keyframe), bool(keyframe or ctrl))
    free = _first_free(model, {tool.body for tool in tools})
    return Scene(model, start, tools, free, filled, own, changed, unused, _sensors(bare), digest)


def _choose_tools(
    spec: mujoco.MjSpec, bare: mujoco.MjModel, begun: Start, seats: Sequence[Held], name: str
) -> list[str]:
    """Return the name of each seat's tool, after adding those that are to be added beside the object. Raises SceneError."""
    bodies = {body.name for body in spec.bodies[1:] if body.name}
    own = [held.tool in bodies for held in seats]
    for held, is_own in zip(seats, own, strict=True):
        if is_own and spec.body(held.tool).mocap:
            _take_mocap(spec, held, bare, begun)
    object_m, radius_m = _object(bare, begun, {held.tool for held, is_own in zip(seats, own, strict=True) if is_own})
    chosen, beside, bits = [], {"left": 0, "right": 0}, _touching_bits(bare)
    for seat, (held, is_own) in enumerate(zip(seats, own, strict=True)):
        chosen.append(held.tool if is_own else _added(held.tool, seat, bodies, name))
        if not is_own:
            sign = -1.0 if held.side == "left" else 1.0
            place = object_m + np.array([sign * (radius_m + CLEAR_M), APART_M * beside[held.side], 0.0])
            beside[held.side] += 1
            _add_tool(spec, chosen[-1], held, place.tolist(), bits)
    return chosen


def _suit_crowd(model: mujoco.MjModel) -> None:
    """Let the solver of a large scene have sparse matrices, and no search in trees of few geoms."""
    if model.nv >= SPARSE_FROM:
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        if max(model.body_geomnum) <= MOST_TRIED_GEOMS:
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE


def _parsed(files: SceneFiles) -> tuple[mujoco.MjSpec, mujoco.MjVfs]:
    """Return the scene as its author has it, and the files with which it is to be compiled."""
    vfs, root = mujoco.MjVfs(), files.root
    for path, data in files.files.items():
        vfs[root + path] = data
    return mujoco.MjSpec.from_file(root + files.main, vfs=vfs), vfs


def _sensors(bare: mujoco.MjModel) -> tuple[str, ...]:
    """Return a name for each number of a scene's sensors: the sensor's, with a number behind it where it has more than one."""
    found = []
    for sensor, name in enumerate(names_of(bare, bare.nsensor, "sensor")):
        size = int(bare.sensor_dim[sensor])
        found += [name] if size == 1 else [f"{name}_{number}" for number in range(size)]
    return tuple(found)


def _unused(
    files: SceneFiles, bare: mujoco.MjModel, taken: Collection[int], begun: bool, controlled: bool
) -> tuple[str, ...]:
    """Return what a scene has and nothing uses. taken: mocap bodies that are tools; begun, controlled: what settings say."""
    unused = []
    if shown_files := files.discarded:
        count = f"{len(shown_files)} mesh file{'s' if len(shown_files) > 1 else ''}"
        unused.append(f"{count} that a URDF shows ({listed(shown_files)})")
    if bare.nkey and not begun:
        unused.append(f"keyframes ({listed(names_of(bare, bare.nkey, 'key'))}): name one as object.keyframe")
    mocaps = [body for body in range(bare.nbody) if bare.body_mocapid[body] >= 0 and body not in taken]
    if mocaps:
        names = [bare.body(body).name or f"body {body}" for body in mocaps]
        unused.append(f"{SCRIPTED[0]} stay where they are ({listed(names)}): name one as a person's tool")
    if bare.nu and not controlled:
        names = names_of(bare, bare.nu, "actuator")
        unused.append(f"{SCRIPTED[1]} stays 0 ({listed(names)}): set object.ctrl, or a keyframe that has it")
    return tuple(unused)


def _digest(files: SceneFiles, seats: Sequence[Held], step_s: float, keyframe: str, ctrl: Sequence[float]) -> str:
    words = [f"{PINCH} {held.tool}" if held.grips else held.tool for held in seats]
    words += [held.side for held in seats] + [held.orientation for held in seats]
    if any(SITE.encode() in data for data in files.files.values()):
        words += [held.user for held in seats]
    words += [str(step_s), *([keyframe, *map(str, ctrl)] if keyframe or ctrl else ())]
    digest = sha256(b"\0".join([files.files[files.main], *[word.encode() for word in words]]))
    for path, data in sorted(files.files.items()):
        if path != files.main:
            digest.update(f"\0{path}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()


def _compiled(spec: mujoco.MjSpec, vfs: mujoco.MjVfs, tools: Sequence[str]) -> mujoco.MjModel:
    """Return the model of a scene whose tools' weight can be carried later: MuJoCo carries none where no body has it."""
    heavy = [spec.body(tool) for tool in tools if not spec.body(tool).gravcomp]
    for body in heavy:
        body.gravcomp = 1.0
    model = _compile(spec, vfs)
    model.body_gravcomp[[body.id for body in heavy]] = 0.0
    return model


def _compile(spec: mujoco.MjSpec, vfs: mujoco.MjVfs) -> mujoco.MjModel:
    """Return the model of a scene. MuJoCo would warn on standard error of textures that a mesh is to have, and nobody draws."""
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        return spec.compile(vfs)


def _free_masses(spec: mujoco.MjSpec) -> None:
    """Let the compiler take masses as they stand: what a scene says of all of them is not said of its tools (`_weigh`)."""
    compiler = spec.compiler
    compiler.settotalmass, compiler.boundmass, compiler.boundinertia, compiler.balanceinertia = -1.0, 0.0, 0.0, True
    compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    compiler.inertiagrouprange = [0, mujoco.mjNGROUP - 1]


def _weigh(spec: mujoco.MjSpec, model: mujoco.MjModel, bare: mujoco.MjModel, taken: Collection[int]) -> bool:
    """Give the scene's own bodies, but for those `taken`, the masses that they have without tools, whose bodies are last.

    Return whether that changes anything, so that the model is to be compiled again.
    """
    own = [body for body in range(1, bare.nbody) if body not in taken]
    keys = ("body_mass", "body_inertia", "body_ipos", "body_iquat")
    if all(np.array_equal(getattr(model, key)[own], getattr(bare, key)[own]) for key in keys):
        return False
    for body in spec.bodies:
        if body.id in own:
            body.explicitinertial, body.mass = True, bare.body_mass[body.id]
            body.inertia, body.ipos, body.iquat = (
                bare.body_inertia[body.id],
                bare.body_ipos[body.id],
                bare.body_iquat[body.id],
            )
            body.fullinertia = np.full(6, np.nan)
    return True


def _suit_memory(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Let MuJoCo choose the memory of contacts where a scene reserves much, as old ones do. Return what changed."""
    asked = {key: getattr(spec, key) for key in ("njmax", "nconmax")}
    if max(asked.values()) <= MOST_RESERVED or spec.memory > 0:
        return ()
    spec.njmax = spec.nconmax = -1
    return tuple(f"size {key} ({count} > MuJoCo's own)" for key, count in asked.items() if count > 0)


def _refuse_endless(model: mujoco.MjModel, name: str) -> None:
    """Raise SceneError for a scene that lets a solver of MuJoCo go on for too long, whichever it is."""
    for key in [key for key in dir(model.opt) if key.endswith(("iterations", "initpoints"))]:
        if (count := getattr(model.opt, key)) > MOST_ITERATIONS:
            raise SceneError(f"{name}: option {key} = {count} is more than {MOST_ITERATIONS}; leave it out")


def _try_steps(scene: Scene, name: str) -> None:
    """Raise SceneError for a scene with a number in it that is none, or huge; the child has limits for what takes too long."""
    model = scene.model
    data = scene.start.data(model)
    mujoco.mj_step(model, data)
    far_m = max(float(np.abs(data.xpos).max()), float(model.geom_rbound.max(initial=0.0)))
    if far_m > MOST_FAR_M:
        cure = "give lengths in metres, or scale its meshes"
        raise SceneError(f"{name}: reaches {far_m:.3g} m, more than {MOST_FAR_M:g} m; {cure}")
    if not bool(np.all(np.abs(data.qvel) < MOST_RATE)):
        raise SceneError(
            f"{name}: its bodies leave all bounds in the first step; look for a number that is none, or huge"
        )
    for _ in range(TRIED_STEPS - 1):
        mujoco.mj_step(model, data)


def _counted(text: str) -> None:
    """Do nothing: MuJoCo would write its warnings to a file here. It counts them, and the world looks at its state."""


def _unloadable(error: Exception, files: SceneFiles) -> SceneError:
    """Return one line of what MuJoCo says."""
    said = " ".join(str(error).replace(files.root, "").split()).removeprefix("Error: ")
    words = shown(said) or type(error).__name__
    cure = "; give the body a geom with mass, or an inertial" if "mjMINVAL" in words else ""
    if "allocate memory" in words or isinstance(error, RuntimeError | MemoryError):  # where a library of C++ found none
        cure = f"; make it smaller: a scene has {MEMORY_BYTES >> 20} MB"
    return SceneError(f"{files.name}: does not load: {words}{cure}")


def _solved(spec: mujoco.MjSpec, options: Set[str], step_s: float) -> tuple[str, ...]:
    """Set how a step is solved. Return what the scene sets and does not get."""
    option = spec.option
    changed = []
    if "timestep" in options and option.timestep != step_s:
        changed.append(f"timestep ({option.timestep:g} > {step_s:.6g})")
    off, on = mujoco.mjtDisableBit, mujoco.mjtEnableBit
    disabled = [
        bit for bit in (off.mjDSBL_DAMPER, off.mjDSBL_EULERDAMP, off.mjDSBL_SENSOR) if option.disableflags & bit
    ]
    changed += [f"flag {bit.name.rpartition('_')[2].lower()} (disable > enable)" for bit in disabled]
    for bit in (on.mjENBL_SLEEP, on.mjENBL_OVERRIDE):  # the latter gives every contact the scene's one setting
        if option.enableflags & bit:
            changed.append(f"flag {bit.name.rpartition('_')[2].lower()} (enable > disable)")
            option.enableflags &= ~int(bit)
    for key, of in _SOLVED.items():
        given = getattr(spec.option, key)
        taken = of(given)
        if key in options and given != taken:
            changed.append(f"{key} ({_option_text(key, given)} > {_option_text(key, taken)})")
        setattr(spec.option, key, taken)
    return tuple(changed)


def _limited(elements: Sequence[Any]) -> list[Any]:
    """Return the joints or tendons that have a range."""
    return [
        element
        for element in elements
        if element.limited != mujoco.mjtLimited.mjLIMITED_FALSE and np.any(element.range)
    ]


def _suit_flexes(spec: mujoco.MjSpec, name: str) -> tuple[str, ...]:
    """Take dampers off the edges of flexible bodies: the integrator has none. Return which. Raises SceneError for springs."""
    changed = []
    for flex in spec.flexes:
        if flex.edgestiffness:
            cure = 'give it <edge equality="true"/>, or <elasticity> where it has two dimensions or more'
            raise SceneError(
                f"{name}: flex {shown(flex.name)!r} has edges of a stiffness of {flex.edgestiffness:g}, which the integrator "
                f"that makes no energy does not have; {cure}, and leave the stiffness out"
            )
        if flex.edgedamping:
            changed.append(f"edge damping of flex {shown(flex.name)} ({flex.edgedamping:g} > 0)")
            flex.edgedamping = 0.0
    return tuple(changed)


def _option_text(key: str, value: Any) -> str:
    """Return an option's value as a scene has it."""
    if kind := {"integrator": mujoco.mjtIntegrator, "solver": mujoco.mjtSolver}.get(key):
        return str(kind(value).name.partition("_")[2]).lower()
    return f"{value:g}"


def _complete(spec: mujoco.MjSpec, options: Set[str], step_s: float) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Set what the world needs, and contact where the scene leaves it as it comes. Returns what was filled in, and its own."""
    filled, own = [], []
    for key, value in _OPTION.items():
        if key in options:
            own.append(f"option {key}")
        else:
            setattr(spec.option, key, value)
            filled.append(f"option {key}")
    fresh = mujoco.MjSpec()
    fixed = fresh.worldbody.add_body()
    friction = {
        "solimp_friction": (STICTION_SHARE, STICTION_SHARE, 0.001, 0.5, 2.0),
        "solref_friction": (2.0 * step_s, 1.0),
    }
    for what, elements, default, wanted in (
        ("geom", spec.geoms, fixed.add_geom(), GEOM),
        ("pair", spec.pairs, fresh.add_pair(), GEOM),
        ("flex", spec.flexes, fresh.add_flex(), GEOM),
        ("equality", spec.equalities, fresh.add_equality(), WELD),
        ("joint", [joint for joint in spec.joints if np.any(joint.frictionloss)], fixed.add_joint(), friction),
        ("joint", _limited(spec.joints), fixed.add_joint(), _LIMIT),
        ("tendon", [tendon for tendon in spec.tendons if np.any(tendon.frictionloss)], fresh.add_tendon(), friction),
        ("tendon", _limited(spec.tendons), fresh.add_tendon(), _LIMIT),
    ):
        for key, value in wanted.items():
            same = [element for element in elements if np.array_equal(getattr(element, key), getattr(default, key))]
            for element in same:
                setattr(element, key, value)
            if same:
                filled.append(f"{what} {key}")
            if len(same) < len(elements):
                own.append(f"{what} {key}")
    option = spec.option
    option.timestep = step_s
    option.enableflags = (option.enableflags | mujoco.mjtEnableBit.mjENBL_ENERGY) & ~int(
        mujoco.mjtEnableBit.mjENBL_SLEEP
    )
    dampers = int(mujoco.mjtDisableBit.mjDSBL_DAMPER) | int(
        mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    )  # the ports are dampers
    dampers |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)  # and contacts are measured by sensors
    option.disableflags = (option.disableflags & ~dampers) | mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return tuple(filled), tuple(own)


def _added(tool: str, seat: int, bodies: set[str], name: str) -> str:
    """Return the name of the body that is added for a seat. Raises SceneError for a tool that there is not."""
    if tool and tool not in TOOLS:
        there = f"; its bodies are {', '.join(map(shown, sorted(bodies)[:MOST_NAMED]))}" if bodies else ""
        raise SceneError(
            f'{name}: there is no body {tool!r} to be a tool{there}; or take "pad", "ball", "box" or "pinch"'
        )
    return f"{ADDED}{seat}"


def _touching_bits(bare: mujoco.MjModel) -> int:
    """Return bits of contype and conaffinity by which an added tool touches a part of each body that anything touches.

    That is MuJoCo's own, 1, where every body has a part with it; else those of a body that has none are added.
    """
    bits = 1
    for body in range(bare.nbody):
        of = [
            int(bare.geom_contype[geom] | bare.geom_conaffinity[geom])
            for geom in np.flatnonzero(bare.geom_bodyid == body)
        ]
        if not any(each & 1 for each in of):
            for each in of:
                bits |= each
    return bits


def _add_tool(spec: mujoco.MjSpec, body_name: str, held: Held, place: Sequence[float], bits: int) -> None:
    """Add a tool at a place. bits: of contype and conaffinity."""
    kind = held.tool or TOOLS[0]
    body = spec.worldbody.add_body(name=body_name, pos=place, gravcomp=1.0)
    if held.orientation in ("", "fixed"):
        joints = [body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis) for axis in np.eye(3)]
    else:
        joints = [body.add_freejoint()]
    if kind == "box":
        geoms = [body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01, 0.01, 0.01])]
    elif (
        kind == PINCH
    ):  # faces along y, which touch each other at an opening of 0; the middle of the thumb's is the tool's place
        finger = body.add_body(name=f"finger of {body_name}", gravcomp=1.0)
        joints.append(finger.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 1.0, 0.0]))
        geoms = [
            _ball(part, FINGER_M, (x, y, z))
            for part, y in ((body, -FINGER_M), (finger, FINGER_M))
            for x in (-FINGER_APART_M, FINGER_APART_M)
            for z in (-FINGER_APART_M, FINGER_APART_M)
        ]
    elif kind == "pad":
        geoms = [_ball(body, 0.008, (0.0, y, z)) for y in (-0.012, 0.012) for z in (-0.012, 0.012)]
    else:
        geoms = [_ball(body, 0.01, (0.0, 0.0, 0.0))]
    for joint in joints:
        _plain(joint, _OF_JOINTS)
    for geom in geoms:
        _plain(geom, _OF_GEOMS)
        geom.mass, geom.contype, geom.conaffinity = TOOL_KG / len(geoms), bits, bits
        for key, value in GEOM.items():
            setattr(geom, key, value)


def _take_mocap(spec: mujoco.MjSpec, held: Held, bare: mujoco.MjModel, start: Start) -> None:
    """Let a hand move a body that a program is to move: it gets joints along the world's axes, and an added tool's mass."""
    body, number = spec.body(held.tool), int(bare.body_mocapid[bare.body(held.tool).id])
    place, turned = start.mocap_pos[number], start.mocap_quat[number]
    body.mocap, body.pos, body.quat = False, place, turned
    body.explicitinertial, body.mass, body.gravcomp = True, TOOL_KG, 1.0
    body.ipos, body.inertia = np.zeros(3), np.full(3, 0.4 * TOOL_KG * MOCAP_M**2)
    if held.orientation in ("", "fixed"):
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, turned / np.linalg.norm(turned))
        for axis in axes.reshape(3, 3):  # the world's, in the body's frame
            _plain(body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis), _OF_JOINTS)
    else:
        _plain(body.add_freejoint(), _OF_JOINTS)


def _plain(element: Any, keys: Sequence[str]) -> None:
    """Give a new joint or geom MuJoCo's own values of these attributes, whatever the scene has for all."""
    fresh = mujoco.MjSpec().worldbody.add_body()
    plain = fresh.add_joint() if keys is _OF_JOINTS else fresh.add_geom()
    for key in keys:
        setattr(element, key, getattr(plain, key))


def _ball(body: mujoco.MjsBody, radius_m: float, centre: Sequence[float]) -> mujoco.MjsGeom:
    return body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius_m, 0, 0], pos=centre)


def _add_sensor(spec: mujoco.MjSpec, body_name: str) -> None:
    """Add the sensor of the forces of a tool's strongest contacts (`scene_contacts`); those of the seats are the last ones."""
    fields = mujoco.mjtConDataField.mjCONDATA_FOUND, mujoco.mjtConDataField.mjCONDATA_FORCE
    what = add_integers(1 << int(field) for field in fields)
    strongest = 2  # how contacts are chosen: MJCF's reduce="maxforce"
    body, kind = mujoco.mjtObj.mjOBJ_XBODY, mujoco.mjtSensor.mjSENS_CONTACT  # with all that hangs on it
    spec.add_sensor(type=kind, objtype=body, objname=body_name, intprm=[what, strongest, MOST_CONTACTS])


def _first_free(model: mujoco.MjModel, tools: set[int]) -> int:
    free = [int(model.jnt_bodyid[joint]) for joint in range(model.njnt) if model.jnt_type[joint] == _FREE[0]]
    return next((body for body in free if body not in tools), -1)


def body_of(scene: Scene, name: str) -> int:
    """Return the number of a body; "" is the object. Raises SceneError."""
    model = scene.model
    named = {model.body(body).name: body for body in range(1, model.nbody)}
    body = named.get(name, -1) if name else scene.object
    if body < 0:
        there = ", ".join(map(shown, sorted(filter(None, named))[:MOST_NAMED]))
        raise SceneError(f"task.body = {name!r} is no body of the scene; its bodies are {there or 'without names'}")
    return body


def _object(
    model: mujoco.MjModel, start: Start, tools: set[str]
) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], float]:
    """Return where the object starts [m] and the radius of a ball around it; the world's middle where there is none."""
    body = _first_free(model, {model.body(tool).id for tool in tools})
    if body < 0:
        return np.zeros(3), 0.0
    geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == body]
    reach = [float(np.linalg.norm(model.geom_pos[geom]) + model.geom_rbound[geom]) for geom in geoms]
    return start.data(model).xpos[body].copy(), max(reach, default=0.0)


def _tool(model: mujoco.MjModel, body_name: str, held: Held, name: str) -> Tool:
    """Return the tool that a body is. Raises SceneError where a port cannot move it so."""
    body, orientation = model.body(body_name).id, held.orientation
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    kinds = [model.jnt_type[joint] for joint in range(first, first + count)]
    root = model.body_parentid[body] == 0
    turned = np.zeros(9)
    mujoco.mju_quat2Mat(turned, model.body_quat[body])
    axes = model.jnt_axis[first : first + count] @ turned.reshape(3, 3).T
    straight = count == PLACES and np.allclose(axes, np.eye(3), rtol=0.0, atol=1e-12)
    if not (root and (kinds == _FREE or (kinds == _SLIDES and straight))):
        raise SceneError(
            f"{name}: body {body_name!r} cannot be a tool: it needs a free joint, or three slide joints along x, y and z "
            "in this order, and the world as its parent, unturned"
        )
    turns = kinds == _FREE
    if orientation and turns == (orientation == "fixed"):
        has, cure = ("a free joint", "free") if turns else ("no free joint", "fixed")
        raise SceneError(
            f'{name}: body {body_name!r} has {has}, so its orientation cannot be "{orientation}"; set "{cure}"'
        )
    opening = _opening(model, body, name) if held.grips else -1
    return Tool(body, int(model.jnt_dofadr[first]), int(model.jnt_qposadr[first]), turns, orientation, opening)


def _opening(model: mujoco.MjModel, body: int, name: str) -> int:
    """Return the joint of a tool's finger: the one child of its body that slides on it. Raises SceneError."""
    fingers = [child for child in range(1, model.nbody) if model.body_parentid[child] == body]
    joints = [int(model.body_jntadr[child]) for child in fingers if model.body_jntnum[child] == 1]
    slides = [joint for joint in joints if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE]
    if len(slides) != 1:
        raise SceneError(
            f"{name}: body {model.body(body).name!r} cannot be a gripper: it needs one child that has a slide joint"
            f" and no other, and {len(slides)} have"
        )
    return slides[0]
