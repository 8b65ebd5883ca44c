"""Advice on a scene of rigid bodies: of its contact settings, line and tools; there is no linear model of it."""

from collections.abc import Iterator

import numpy as np

from cogrip.analysis.advice.advice import gaps, overloads, unbounded
from cogrip.analysis.advice.finding import Finding, Level, plain
from cogrip.analysis.advice.line_advice import free_tool, loop_s, press_n, pressed, stroke_s
from cogrip.analysis.advice.scene_overlaps import DEEP_M, outside_ranges, overlaps
from cogrip.analysis.linear.linear_session import seats_on_devices
from cogrip.devices.for_user import make_for
from cogrip.machine.addition import add_floats
from cogrip.protocol.axes import GRIP_AXES
from cogrip.protocol.laws.felt_stiffness import felt_stiffness
from cogrip.protocol.laws.scene_contact import CONTACT_RATE_PS2
from cogrip.protocol.scene_words import changed_words, left_out_words
from cogrip.protocol.settings.delays import line_delay
from cogrip.protocol.settings.room import seat_axes
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings
from cogrip.server.worlds.scenes.local_geometry import local_geometry, unfit_tool
from cogrip.server.worlds.scenes.scene_file import ADDED, Scene, scene_of_settings
from cogrip.server.worlds.scenes.scene_shapes import shapes_of
from cogrip.server.worlds.scenes.scene_surfaces import MOST_SCENE_TRIANGLES
from cogrip.server.worlds.scenes.scene_text import MOST_NAMED
from cogrip.server.worlds.scenes.velocity_forces import linked_dofs


def scene_findings(settings: Settings) -> list[Finding]:
    """Return what is worth knowing before anyone holds a tool of the scene. Raises SceneError, DeviceError."""
    seats = [seat for seat, _ in seats_on_devices(settings)]
    scene = scene_of_settings(settings, seats[0].rates.frame_s)
    waves = [seat for seat in seats if seat.coupling.traits.felt_through_waves]
    felt = [each for seat in waves for each in _felt(settings, scene, seat)]
    local = [each for seat in seats if seat.coupling.traits.local for each in _local(settings, scene, seat)]
    grips = [each for seat in seats if seat.object.axes == GRIP_AXES for each in _grip(settings, scene, seat)]
    return [*_contact(scene), *felt, *grips, *local, *_drawn(scene), *_loads(settings)]


def _contact(scene: Scene) -> Iterator[Finding]:
    if scene.filled:
        yield Finding("contact", f"contact that creates no energy is set: {', '.join(scene.filled)}")
    if scene.changed:
        yield Finding("contact", changed_words(scene.changed), "note")
    if any(each.endswith(" margin") and not each.startswith(("joint", "tendon")) for each in scene.own):
        text = "bodies rest where their surfaces meet, whatever margin the scene sets: MuJoCo alone keeps them that far apart"
        yield Finding("contact", text, "note")
    option = scene.model.opt
    if medium := [f"{key} {getattr(option, key):g}" for key in ("density", "viscosity") if getattr(option, key) > 0.0]:
        wind = f", wind {', '.join(f'{each:g}' for each in option.wind)} m/s" if np.any(option.wind) else ""
        text = (
            f"the scene's medium ({', '.join(medium)}{wind}) acts on added tools as on all bodies: nowhere is free air"
        )
        yield Finding("medium", text, "note")
    inside = overlaps(scene)
    deep: Level = "warning" if any(each.depth_m >= DEEP_M for each in inside) else "note"
    levels: tuple[tuple[list[str], str, Level], ...] = (
        ([each.text for each in inside], "pairs of bodies are inside of each other", deep),
        (outside_ranges(scene), "joints begin outside of their range", "warning"),
    )
    for texts, more, level in levels:
        for text in texts[:MOST_NAMED]:
            yield Finding("start", text, level)
        if len(texts) > MOST_NAMED:
            yield Finding("start", f"{len(texts) - MOST_NAMED} more {more}", level)
    if len(linked_dofs(scene.model)):
        text = (
            "Coriolis and gyroscopic forces of linked bodies are taken at the middle of a step, where they do no work"
        )
        yield Finding("motion", text)
    for text in scene.unused:
        yield Finding("not used", text, "note")
    if scene.own:
        text = (
            f"the scene sets {', '.join(scene.own)} itself: such contact may create energy, of which the limiter lets no more"
            " back to the hands than they put in and 1 mJ; leave these out, or run it and look at `energy_limiter`"
        )
        yield Finding("contact", text, "warning")


def _drawn(scene: Scene) -> Iterator[Finding]:
    """Yield which surfaces are drawn by less than they are, and what MuJoCo draws of the scene and viewers do not."""
    drawn = shapes_of(scene, np.zeros(3))
    for names, how in ((drawn.boxed, "as the boxes around them"), (drawn.coarser, "by fewer triangles than they have")):
        if names:
            more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
            text = (
                f"drawn {how}, {len(names)} in all: {', '.join(names[:MOST_NAMED])}{more}; a scene is drawn by "
                f"{MOST_SCENE_TRIANGLES} triangles at most; contact is the same"
            )
            yield Finding("drawn", text, "note")
    if drawn.left_out:
        yield Finding("drawn", left_out_words(drawn.left_out), "note")


def _local(settings: Settings, scene: Scene, seat: SeatSettings) -> Iterator[Finding]:
    """Yield which contact is rendered at the hand, and which the server's is felt through the line (theory 8.7)."""
    geometry = local_geometry(scene, seat.seat)
    if geometry.why and scene.tools[seat.seat].driven:
        yield Finding("local", unfit_tool(seat.user, geometry.why), "warning", refused=True)
        return
    if geometry.why:
        text = f"{seat.user}: all contact is the server's, and the line holds the tool all the time: {geometry.why}"
        yield Finding("local", text, "warning")
        yield from _felt(settings, scene, seat)
        return
    fixed = len(geometry.shapes) - len(geometry.balls)
    shapes = "1 fixed shape" if fixed == 1 else f"{fixed} fixed shapes"
    text = f"{seat.user}: contact with {shapes} is rendered at the hand; bodies that move are felt through the line"
    yield Finding("local", text)
    if left := geometry.left_out:
        more = f" and {len(left) - MOST_NAMED} more" if len(left) > MOST_NAMED else ""
        text = f"{seat.user}: contact with {', '.join(left[:MOST_NAMED])}{more} is the server's: no client renders it"
        yield Finding("local", text, "note")


def felt_npm(scene: Scene, seat: SeatSettings) -> float:
    """Return the stiffness with which a hand feels a fixed body at rest [N/m] (theory 8.4)."""
    tool_kg, b = float(scene.model.body_mass[scene.tools[seat.seat].body]), seat.coupling.impedance_nspm
    contact_npm = CONTACT_RATE_PS2 * (tool_kg + b * float(scene.model.opt.timestep))
    return felt_stiffness(contact_npm, seat.line_compliance(_loop_frames(seat)))


def _felt(settings: Settings, scene: Scene, seat: SeatSettings) -> Iterator[Finding]:
    """Yield the stiffness and the mass that a hand feels (theory 8.4), and whether its task is too much for them."""
    tool_kg, b = float(scene.model.body_mass[scene.tools[seat.seat].body]), seat.coupling.impedance_nspm
    fixed_npm = felt_npm(scene, seat)
    own = "" if "geom solref" not in scene.own else " where contact is as hard as by default"
    user = settings.users[seat.seat]
    level, words = pressed(fixed_npm, press_n(user))
    text = f"{seat.user}: a fixed body is felt with {plain(fixed_npm)} N/m at rest{own}: {words}"
    yield Finding("felt", text, level)
    yield free_tool(seat.user, "tool", tool_kg + _line_kg(seat, b), tool_kg, loop_s(seat), stroke_s(user))


def _grip(settings: Settings, scene: Scene, seat: SeatSettings) -> Iterator[Finding]:
    """Yield what the fingers of a gripper feel of their line, whose impedance is their own (theory 8.8)."""
    joint, b_g = scene.tools[seat.seat].opening, seat.coupling.further_impedance
    finger_kg = float(scene.model.body_mass[scene.model.jnt_bodyid[joint]])
    most_npm = b_g / (seat.coupling.impedance_nspm * seat.line_compliance(_loop_frames(seat)))
    mass_kg = finger_kg + _line_kg(seat, b_g)
    user = settings.users[seat.seat]
    text = (
        f"{seat.user}: the gripper's line is a spring of {plain(most_npm)} N/m at rest, at b_g = {plain(b_g, 3)} N s/m, in "
        f"series with what is between the fingers"
    )
    if (between_npm := _between(scene, seat, b_g, finger_kg)) is not None:
        held = scene.model.body(scene.object).name or "the object"
        felt_npm = 1.0 / (1.0 / between_npm + 1.0 / most_npm)
        text += f": {held} with flat sides between them is felt with {plain(felt_npm)} N/m"
    yield Finding("felt", text)
    yield free_tool(seat.user, "finger", mass_kg, finger_kg, loop_s(seat), None)
    if gripper := make_for(user, seat_axes(settings, user)).capability.gripper:
        yield from gaps(f"{seat.user}: between the fingers ", seat, b_g, gripper.continuous_force_n)


def _between(scene: Scene, seat: SeatSettings, b_g: float, finger_kg: float) -> float | None:
    """Return the stiffness of the scene's object between the faces of an added gripper [N/m] (theory 8.8).

    None where it is not known: without an object, or where a gripper or contact of the scene's own holds it.
    """
    model, tool = scene.model, scene.tools[seat.seat]
    added = model.body(tool.body).name.startswith(ADDED)
    if scene.object < 0 or not added or {"geom solref", "geom solimp"} & set(scene.own):
        return None
    balls, step_s = int(model.body_geomnum[model.jnt_bodyid[tool.opening]]), float(model.opt.timestep)
    thumb_kg = float(model.body_mass[tool.body])
    object_kg = float(model.body_subtreemass[scene.object])
    sides_kg = thumb_kg + seat.coupling.impedance_nspm * step_s, finger_kg + b_g * step_s
    softness = [(1.0 / side_kg + 1.0 / object_kg) / (balls * CONTACT_RATE_PS2) for side_kg in sides_kg]
    return 1.0 / add_floats(softness)


def _loop_frames(seat: SeatSettings) -> float:
    """Return the frames from a forward wave's own to that in which its answer is applied: 2d + 1."""
    return add_floats(line_delay(seat.playout, link, seat.rates).frames for link in (seat.up, seat.down)) + 1.0


def _line_kg(seat: SeatSettings, impedance_nspm: float) -> float:
    """Return the mass of a line of this impedance that moves freely (theory 8.4)."""
    return 0.5 * impedance_nspm * loop_s(seat)


def _loads(settings: Settings) -> Iterator[Finding]:
    for text in overloads(settings):
        yield Finding("device", text, "warning", refused=True)
    for text in unbounded(settings):
        yield Finding("scheme", text, "warning", refused=True)
