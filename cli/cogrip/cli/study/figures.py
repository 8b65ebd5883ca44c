"""`cogrip figures`: the paper's figures from the lifted model and from sessions, and what it does not show."""

from pathlib import Path

from cogrip.cli.terminal.console import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.sim.analysis.figures.page import save_page
from cogrip.sim.analysis.figures.registry import FIGURES


def figures(*names: str, out: Path = Path("figures")) -> int:
    """Draw P's Fig. 4, 5 and 6, the three schemes side by side, their dependence on masses, and the decimators.

    Each as PNG, SVG, and the numbers behind it as CSV. The walk through the paper that goes with them is docs/paper.md.

    Parameters
    ----------
    names
        Which: fig4, fig6, regions, masses, fig5, decimators; all if none is named.
    out
        Folder to write into. Files of these names are written anew, others are left alone.
    """
    console = make_console(soft_wrap=True)
    known = {entry.name: entry for entry in FIGURES}
    for name in names:
        if name not in known:
            raise BadInput(f"figures: there is no {name!r}; there are {', '.join(known)}")
    for entry in FIGURES:
        if names and entry.name not in names:
            continue
        with make_console(stderr=True).status(f"drawing {entry.name}"):
            page = entry.make()
        try:
            paths = save_page(out, page)
        except OSError as error:
            raise Problem(f"--out {out}: cannot be written: {error}") from None
        console.print(f"{page.title}: {paths[0]}", markup=False)
        console.print(f"  {page.caption}", markup=False)
    return 0
