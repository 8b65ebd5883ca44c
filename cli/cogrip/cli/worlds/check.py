"""`cogrip worlds check`: the conformance suite on one world, for its author; of a scene's file, what becomes of it."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from cogrip.cli.session.python_worlds import allow_python_worlds
from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import SUFFIX, shipped_names
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.parameters import Overrides
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.worlds.scene_check import SUFFIXES, check_scene, shown_on
from cogrip.machine.addition import add_integers
from cogrip.protocol.settings.object_kinds import KINDS, PYTHON, kind_of, split_python
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.table import SettingsError
from cogrip.server.io.call_limit import COMPUTE_LIMIT_S, WAIT_LIMIT_S, call_limit
from cogrip.server.schemes import make_room_world
from cogrip.server.worlds.conformance import CHECKS, Subject, UnfitError
from cogrip.server.worlds.guarded import GuardedWorld, TooLongError, error_line
from cogrip.server.worlds.registry import WorldKindError, world_class_of
from cogrip.server.worlds.world import World, WorldError

MOST_SEATS = 4  # most seats that are tried


def world_check(world: str, /, *, overrides: Overrides = (), json: Json = None) -> int:
    """Run the conformance suite on one world, or tell what becomes of a scene.

    A world is tried with its fewest and its most seats and axes, up to four and three. Exit code 0 when all promises are kept.
    Of a scene's file it is told what is loaded, where tools are added, what is set, changed and not used, what hands feel, what
    energy it makes in random pushes, what a frame costs, and up to which delay two people hold its object. Exit code 0 when it
    can be used.

    Parameters
    ----------
    world
        A kind of object (`cogrip worlds list`), `python:FILE.py:CLASS`, which is run, settings, whose world is tried as it
        stands there, or a scene's file (MJCF or URDF).
    """
    console = make_console(soft_wrap=True)
    if world.lower().endswith(SUFFIXES):
        answer = check_scene(Path(world), overrides) if json else check_scene(Path(world), overrides, shown_on(console))
        if json:
            write_json(answer, json)
        return 0 if answer["usable"] else 1
    if overrides or json:
        raise BadInput("--set and --json are of a scene's file; put settings of a world into a file")
    cases = _cases(world)
    broken = add_integers(not _keeps(check, cases, console) for check in CHECKS)
    console.print(f"{len(CHECKS) - broken} of {len(CHECKS)} promises kept")
    return 1 if broken else 0


def _keeps(check: Callable[[Subject], str], cases: dict[str, Subject], console: Console) -> bool:
    """Run one check on every case, and print what came of it."""
    measured = ""
    for case, subject in cases.items():
        try:
            measured = check(subject)
        except (UnfitError, WorldError) as error:
            problem = str(error)
        except TooLongError:
            problem = f"one step computes for more than {COMPUTE_LIMIT_S:g} s, or takes more than {WAIT_LIMIT_S:g} s"
        except (Exception, SystemExit) as error:  # noqa: BLE001 (its author has to see it)
            problem = error_line(error)
        else:
            continue
        console.print(f"✗ {check.__name__}, {case}: {problem}", markup=False, highlight=False)
        return False
    console.print(f"✓ {check.__name__}{': ' if measured else ''}{measured}", markup=False, highlight=False)
    return True


def _cases(world: str) -> dict[str, Subject]:
    """Return what is tried, by number of seats and axes. Raises BadInput."""
    if world.endswith(SUFFIX) or (world in shipped_names() and world not in KINDS):
        settings = load(Path(world))
        if not settings.coupling.traits.felt_through_waves:
            raise BadInput(f'{world}: coupling.kind = "{settings.coupling.kind}": only worlds for waves are checked')
        return dict([_case(settings)])
    if kind_of(world).scene:
        raise BadInput(f"{world}: which one? Give settings with it, such as lift")
    kind = world
    if world.startswith(PYTHON):
        file, name = split_python(world)
        allow_python_worlds((Path(file).absolute().parent,))
        kind = f"{PYTHON}{Path(file).absolute()}:{name}"
    with BadInput.of(WorldKindError, SettingsError):
        found = world_class_of(kind).make
        axes, seats = found.axes_allowed, found.seats_allowed  # type: ignore[attr-defined]
        few, many = (
            (min(axes), min(seats)),
            (max(axes), max(each for each in seats if each <= max(MOST_SEATS, min(seats)))),
        )
        return dict(_case(resolve(_table(kind, *each))) for each in dict.fromkeys((few, many)))


def _table(kind: str, axes: int, seats: int) -> dict[str, object]:
    users = [{"name": f"user{number}", "side": ("left", "right")[number % 2]} for number in range(seats)]
    return {"object": {"kind": kind, "axes": axes}, "users": users}


def _case(settings: Settings) -> tuple[str, Subject]:
    seats = [seat_settings(settings, seat) for seat in range(len(settings.users))]

    def make() -> World:
        world = make_room_world(settings, seats)
        return world.inner if isinstance(world, GuardedWorld) else world

    with BadInput.of(WorldKindError, WorldError):
        make()
    people, axes = len(seats), settings.object.axes
    name = f"{people} {'seat' if people == 1 else 'seats'}, {axes} {'axis' if axes == 1 else 'axes'}"
    subject = Subject(make, call_limit, (time.perf_counter_ns, time.thread_time_ns))
    if settings.object.traits.scene:
        from cogrip.server.worlds.scenes.scene_springs import uncounted_j  # MuJoCo is loaded where there is a scene

        subject = replace(subject, uncounted=uncounted_j)
    return name, subject
