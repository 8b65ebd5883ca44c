"""`cogrip figures`: the paper's figures from the lifted model and from sessions, and further ones."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from cogrip.analysis.figures.page import save_page
from cogrip.analysis.figures.registry import FIGURES
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem


def figures(*names: Annotated[str, Parameter(required=False)], out: Path = Path("figures")) -> int:
    """Draw the paper's figures, and ours beside them.

    P's Fig. 4, 5 and 6, the three schemes side by side, their dependence on masses, and the decimators, each as PNG, SVG, and
    the numbers behind it as CSV; docs/paper.md goes through them.

    Parameters
    ----------
    names
        Which: fig4, fig6, regions, masses, fig5, decimators; all if none is named.
    out
        Folder to write into. Files of these names are overwritten, others are kept.
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
        with Problem.of(OSError, where=f"--out {out}: cannot be written: "):
            paths = save_page(out, page)
        console.print(f"{page.title}: {paths[0]}")
        console.print(f"  {page.caption}")
    return 0
