"""Delay up to which two people hold a scene's object between added tools: sessions in virtual time, one for each delay.

Two simulated hands go level with the object's centre of mass, close in along x until they touch, press, lift it and hold it
still, in strokes of 1 s, as if there were no delay. It stays held where it was lifted by LIFTED_M and from then to the end does
not come down again, is left by no tool, and slips by at most MOST_SLIP_M along each. Each hand presses with

    max(LIGHT_GRIP_N, MARGIN m g / (2 mu))        m g weight of the object, mu friction between it and a tool

and goes further up by what half of the weight stretches hand and line, m g / 2 (1/K_hand + 1/K_line), as people lift by sight.
"""

from collections.abc import Callable, Sequence
from math import inf
from typing import NamedTuple

import mujoco  # type: ignore[import-untyped]
import numpy as np
from msgspec.structs import replace

from cogrip.analysis.advice.finding import Finding, plain
from cogrip.analysis.advice.line_advice import LIGHT_GRIP_N
from cogrip.analysis.advice.scene_advice import felt_npm
from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_contacts import LIFTED_M
from cogrip.server.worlds.scenes.scene_file import ADDED, Scene, scene_of_settings
from cogrip.server.worlds.scenes.scene_places import Approach, approaches
from cogrip.sim.laboratory import Laboratory

DELAYS_MS = (0.0, 10.0, 20.0, 50.0, 100.0, 200.0, 300.0)
"""Delays of each direction that are tried, in this order, until one at which the object is not held."""
MOST_SLIP_M = 0.002  # most slip of a tool along the object while it is held
DOWN_M = 0.001  # height at and below which the object has come down again
MOST_APART = 4  # most frames on end in which a tool of a held object touches nothing, as it swings
LIFT_M, HOLD_S = 0.03, 2.0  # how high hands lift, and for how long they hold still then
MARGIN = 3.0  # ratio of the force of hands to the least at which friction holds the object at rest
HAND_NPM = 300.0  # stiffness of a hand
MOST_PRESS_N = 20.0  # largest force with which a hand presses
_START_S, _STROKE_S, _STROKES = (
    0.5,
    1.0,
    4,
)  # time before the strokes, of each, and their number: beside, approach, press, lift
SECONDS = _START_S + _STROKES * _STROKE_S + HOLD_S


class HoldResult(NamedTuple):
    """Result of a session. lifted_m: height of the object at its end; slip_m: most slip while it was lifted; why: not held."""

    delay_ms: float
    lifted_m: float
    slip_m: float
    why: str

    @property
    def held(self) -> bool:
        return not self.why


class Hold(NamedTuple):
    """Result of all sessions. why: nothing was tried, or not all, "" where all was; press_n: of each hand."""

    body: str
    press_n: float
    tried: tuple[HoldResult, ...]
    why: str = ""

    @property
    def up_to_ms(self) -> float | None:
        """Return the largest delay at which the object is held, and at all shorter ones; None where it is at none."""
        return max((each.delay_ms for each in self.tried if each.held), default=None)

    def finding(self) -> Finding:
        """Return it in a sentence."""
        if not self.tried:
            return Finding("held", f"no delay up to which two people hold something: {self.why}", "note")
        how = (
            f"two hands that press with {plain(self.press_n, 2)} N from left and right, lift it by {1e3 * LIFT_M:g} mm and "
            f"hold it for {HOLD_S:g} s"
        )
        up_to, last = self.up_to_ms, self.tried[-1]
        if up_to is None and last.why:
            return Finding("held", f"{self.body} is not held by {how}, without any delay: {last.why}", "note")
        sessions = f"{len(self.tried)} session{'s' if len(self.tried) > 1 else ''} of {SECONDS:g} s in virtual time"
        beyond = (
            f"; at {last.delay_ms:g} ms {last.why}"
            if last.why
            else f"; {self.why}"
            if self.why
            else ", the longest tried"
        )
        text = (
            f"{self.body} stays held by {how} up to {up_to:g} ms of delay each way, slipping by at most "
            f"{1e3 * MOST_SLIP_M:g} mm{beyond} ({sessions})"
        )
        return Finding("held", text)


def hold(
    settings: Settings, stopped: Callable[[], bool] = lambda: False, delays_ms: Sequence[float] = DELAYS_MS
) -> Hold:
    """Return up to which delay the object is held; the settings' own delay has no part in it. Raises SceneError.

    stopped: returns True where no more is to be computed
    """
    scene = scene_of_settings(settings, seat_settings(settings, 0).rates.frame_s)
    body, weight_n, press_n, why = _object(settings, scene)
    if why:
        return Hold(body, press_n, (), why)
    sides = [-1.0 if user.side == "left" else 1.0 for user in settings.users]
    tools = [tool.body for tool in scene.tools]
    found = approaches(scene.model, scene.start, tools, sides, scene.object)
    if found is None:
        return Hold(body, press_n, (), f"{body} has no two sides along x at which both tools touch it and nothing else")
    tried: list[HoldResult] = []
    for delay_ms in delays_ms:
        result = _session(settings, scene, found, (weight_n, press_n), delay_ms, body, stopped)
        if result is None:
            return Hold(
                body, press_n, tuple(tried), f"from {delay_ms:g} ms on nothing was tried, as that takes too long"
            )
        tried.append(result)
        if not result.held:
            break
    return Hold(body, press_n, tuple(tried))


def _object(settings: Settings, scene: Scene) -> tuple[str, float, float, str]:
    """Return the object's name and weight, the force to hold it with [N], and why nobody holds it, "" where somebody may."""
    model, body = scene.model, scene.object
    if body < 0:
        return "", 0.0, 0.0, "the scene has no free body that is no tool"
    name = model.body(body).name or f"body {body}"
    sides = [user.side for user in settings.users]
    if sorted(sides) != ["left", "right"]:
        return name, 0.0, 0.0, "that takes two people, one on the left and one on the right"
    if not all(model.body(tool.body).name.startswith(ADDED) for tool in scene.tools):
        return name, 0.0, 0.0, "it is measured with added tools, and the scene's own are named as tools"
    geoms = [geom for geom in range(model.ngeom) if model.body_rootid[model.geom_bodyid[geom]] == body]
    mu = min((_friction(model, geom) for geom in geoms), default=0.0)
    weight_n = float(
        model.body_subtreemass[body] * np.linalg.norm(model.opt.gravity) * (1.0 - model.body_gravcomp[body])
    )
    if mu <= 0.0:
        return name, weight_n, 0.0, f"{name} has no friction"
    press_n = max(LIGHT_GRIP_N, 0.5 * MARGIN * weight_n / mu)
    if press_n > MOST_PRESS_N:
        need = f"with {MARGIN:g} times what friction needs hands would press with {plain(press_n, 2)} N"
        return name, weight_n, press_n, f"{name} weighs {plain(weight_n, 2)} N, and {need}, more than {MOST_PRESS_N:g}"
    return name, weight_n, press_n, ""


def _friction(model: mujoco.MjModel, geom: int) -> float:
    """Return the coefficient of friction between a geom and an added tool, whose own is 1."""
    own = float(model.geom_friction[geom, 0])
    return own if model.geom_priority[geom] > 0 else max(1.0, own)


def _session(
    settings: Settings, scene: Scene, found: tuple[Approach, ...], forces_n: tuple[float, float], delay_ms: float,
    body: str, stopped: Callable[[], bool],
) -> HoldResult | None:  # fmt: skip
    """Return what becomes of the object at a delay, None where the session was stopped. forces_n: its weight, and the press."""
    weight_n, press_n = forces_n
    link = replace(settings.link, delay_ms=delay_ms)
    delayed = replace(settings, link=link, seconds=SECONDS)
    users = []
    for seat, (user, way) in enumerate(zip(settings.users, found, strict=True)):
        line_npm = felt_npm(scene, seat_settings(delayed, seat))
        sag_m = 0.5 * weight_n * (1.0 / HAND_NPM + 1.0 / line_npm)
        sign = "" if user.side == "left" else "-"
        hand = (
            f"grasp&direction={sign}1&gap_m={way.gap_m:.6g}&press_n={press_n:.6g}&line_npm={line_npm:.6g}"
            f"&lift_m={LIFT_M + sag_m:.6g}&hand_stiffness_npm={HAND_NPM:g}"
            f"&first_m={','.join(f'{each:.6g}' for each in way.first_m)}&start_s={_START_S:g}&stroke_s={_STROKE_S:g}&hold_s=60"
        )
        users.append(replace(user, device="sim:ideal", hand=hand))
    laboratory = Laboratory(replace(delayed, users=tuple(users)))
    world = laboratory.room.world
    assert isinstance(world, SceneWorld)
    watch = _LiftWatch(world)
    laboratory.run(each_frame=lambda _: watch.frame(), stopped=stopped)
    if not laboratory.room.world.failed and watch.frames < laboratory.frames:
        return None
    why = laboratory.incident or watch.why(body)
    return HoldResult(delay_ms, watch.height_m, watch.slip_m, why)


class _LiftWatch:
    """Watches a scene's object from when it is lifted on. slip_m: most that a tool has slipped since, as far as it touched."""

    def __init__(self, world: SceneWorld) -> None:
        self._world, self._start_m = world, world.object.at[2]
        self.frames, self.height_m, self.slip_m = 0, 0.0, 0.0
        self._highest_m, self._lowest_m = 0.0, inf
        self._at_lift: list[float] = []
        self._apart = self._longest = 0  # frames on end in which a tool touched nothing

    def frame(self) -> None:
        """Enter a frame."""
        self.frames += 1
        self.height_m = float(self._world.object.at[2] - self._start_m)
        self._highest_m = max(self._highest_m, self.height_m)
        if self._highest_m <= LIFTED_M:
            return
        touches = self._world.contacts.touches
        self._at_lift = list(map(min, self._at_lift or [inf] * len(touches), (touch.slip_m for touch in touches)))
        self.slip_m = max(self.slip_m, *(touch.slip_m - at for touch, at in zip(touches, self._at_lift, strict=True)))
        self._lowest_m = min(self._lowest_m, self.height_m)
        self._apart = 0 if all(touch.normal_n > 0.0 for touch in touches) else self._apart + 1
        self._longest = max(self._longest, self._apart)

    def why(self, body: str) -> str:
        """Return why the object counts as not held, "" where it is held."""
        if self._highest_m <= LIFTED_M:
            return f"{body} was lifted by {1e3 * self._highest_m:.1f} mm alone"
        if self.slip_m > MOST_SLIP_M:
            return f"it slips by {1e3 * self.slip_m:.1f} mm"
        if self._lowest_m <= DOWN_M:
            return "it comes down to where it stood"
        if self._longest > MOST_APART:
            return f"a tool leaves it for {self._longest} frames"
        return ""
