"""Every page of `cogrip figures`, in its order."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from cogrip.analysis.figures.decimators import decimator_page
from cogrip.analysis.figures.page import FigurePage
from cogrip.analysis.figures.paper_regions import masses, one_scheme, side_by_side, virtual_coupling
from cogrip.analysis.figures.wall_contact import wall_page


class Entry(NamedTuple):
    """A page: its file name, and the function that draws it."""

    name: str
    make: Callable[[], FigurePage]


FIGURES = (
    Entry("fig4", lambda: one_scheme("paper", "fig4", "Fig. 4: the paper's wave scheme")),
    Entry("fig6", virtual_coupling),
    Entry("regions", side_by_side),
    Entry("masses", masses),
    Entry("fig5", wall_page),
    Entry("decimators", decimator_page),
)
