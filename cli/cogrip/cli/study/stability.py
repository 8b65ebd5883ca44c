"""`cogrip stability`: spectral radius, largest stable stiffness, and stable region of two people's stiffnesses."""

from pathlib import Path

from cyclopts import App

from cogrip.analysis.advice.free_end import free_end, free_end_text
from cogrip.analysis.linear.linear_session import FORMS, ModelError
from cogrip.analysis.linear.stability import largest_stable, verdict
from cogrip.cli.study.analysis_query import AS_IT_STANDS, ModelQuery, Query
from cogrip.cli.study.partner_room import tell_partners
from cogrip.cli.terminal.output import make_console, write_json
from cogrip.cli.terminal.parameters import Config
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.tables import say
from cogrip.devices.device import DeviceError

stability = App(name="stability")


@stability.command
def radius(config: Config, /, *, query: ModelQuery = AS_IT_STANDS) -> int:
    """Print the spectral radius of the lifted model of one network frame (P eq. 36).

    Eigenvalues that the structure puts at 1 are counted by name: with any, the whole map's radius is at least 1. "Stable"
    looks at all the others. With models of partners: the loop gain, for hands of several stiffnesses.
    """
    if (settings := query.settings(config)).coupling.traits.gated:
        return tell_partners(settings, query.json, str(config))
    model = query.model(config)
    found, session = verdict(model), model.session
    free = {one.name: judged for number, one in enumerate(session.people) if (judged := free_end(session, number))}
    if query.json:
        answer = {
            "scheme": found.form, "spectral_radius": found.spectral_radius, "structural": len(found.structural),
            "states": found.states, "stable": found.stable,
        }  # fmt: skip
        write_json(answer, query.json)
        return 0
    console = make_console()
    say(console, f"{FORMS[found.form].title}: {'stable' if found.stable else 'NOT stable'}")
    say(console, f"spectral radius {found.spectral_radius:.6g}; without structural eigenvalues {found.decaying:.6g}")
    say(console, f"{found.states} states; structural eigenvalues at 1: {', '.join(found.structural) or 'none'}")
    for name, judged in free.items():
        say(console, f"{name}: {free_end_text(judged, session.frame_s)}")
    say(console, f"({query.conditions})")
    return 0


@stability.command
def limit(config: Config, /, *, query: ModelQuery = AS_IT_STANDS) -> int:
    """Print the largest stiffness up to which the session is stable.

    All users' stiffnesses grow together, in the proportion they have in the settings; the answer is the largest of them.
    """
    model = query.model(config)
    with BadInput.of(ValueError, where=f"{config}: "):
        found = largest_stable(model)
    if query.json:
        answer = {"largest_stable_stiffness_npm": found.stiffness_npm, "searched_to_npm": found.searched_to_npm}
        write_json(answer, query.json)
        return 0
    if found.stiffness_npm is None:
        text = f"stable at any stiffness up to {found.searched_to_npm:g} N/m"
    elif found.stiffness_npm == 0.0:
        text = "stable at no stiffness"
    else:
        text = f"stable up to {found.stiffness_npm:.6g} N/m"
    if found.stable_again:
        text += ", and again at some stiffness beyond"
    console = make_console()
    say(console, f"{model.session.traits.title}: {text}")
    say(console, f"({query.conditions})")
    return 0


@stability.command
def region(
    config: Config,
    /,
    *,
    out: Path,
    query: Query = AS_IT_STANDS,
    delays_frames: str = "0,1,2,4",
    to_npm: str = "",
    grid: int = 0,
) -> int:
    """Draw the stable region in the plane of the first two users' stiffnesses, at several delays: PNG, SVG, CSV and JSON.

    Its boundary is traced, and verified on both sides: stable just inside, unstable just outside. Further users keep their
    own stiffness. Exit code 1 if a boundary could not be verified.

    Parameters
    ----------
    out
        Folder for region.png, .svg, .csv and .json. The answer to another query there is never overwritten.
    delays_frames
        Delays of each direction in network frames, with commas between them.
    to_npm
        How far the axes go [N/m], one number or two with a comma between them; else as far as the boundaries need.
    grid
        Also compute a dense grid of so many cells a side, into the CSV and as a thin contour.
    """
    from cogrip.analysis.figures.page import FilesInTheWayError, save_page
    from cogrip.analysis.figures.region import extent, frames, region_page, region_record
    from cogrip.analysis.linear.region import regions

    settings = query.settings(config)
    delays = _numbers(delays_frames, "--delays-frames")
    box = _sides(to_npm) if to_npm else None
    with BadInput.of(ModelError, DeviceError):
        found, box = regions(
            settings, delays, to_npm=box, grid_cells=grid, hands=query.hands, estimated=query.estimated
        )
    query.tell_rounding(*(each.session for each in found))
    page = region_page(found, box, query.conditions, query.estimated)
    record = region_record(found, box, settings, query.hands, query.estimated)
    with (
        Problem.of(OSError, where=f"--out {out}: cannot be written: "),
        BadInput.of(FilesInTheWayError, where="--out: "),
    ):
        paths = save_page(out, page, record)
    console = make_console()
    say(console, f"({query.conditions})")
    for each in found:
        doubt = "" if each.boundary.verified else "  NOT VERIFIED: see radius_inside and radius_outside in the CSV"
        say(console, f"{frames(each.delay_frames)} each direction: {extent(each.boundary)}{doubt}")
    say(console, "written: " + ", ".join(str(path) for path in paths))
    return 0 if all(each.boundary.verified for each in found) else 1


def _floats(text: str) -> list[float]:
    """Return the numbers of a text with commas, none where one of them is no number."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        return []


def _numbers(text: str, flag: str) -> list[float]:
    numbers = _floats(text)
    if not numbers:
        raise BadInput(f"{flag} {text!r}: write numbers with commas between them, such as 0,1,2,4")
    if len(set(numbers)) < len(numbers):
        raise BadInput(f"{flag} {text!r}: a number stands twice")
    return numbers


def _sides(text: str) -> tuple[float, float]:
    sides = _floats(text)
    if len(sides) not in (1, 2):
        raise BadInput(
            f"--to-npm {text!r}: write one number, or two with a comma between them, such as 5000 or 5000,2000"
        )
    return sides[0], sides[-1]
