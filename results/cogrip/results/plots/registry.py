"""Every plot of a report, in its order.

In all of them solid is what the hand's end knows, dashed what the object's end knows; a person keeps one colour.
"""

from collections.abc import Callable
from typing import NamedTuple

from matplotlib.figure import Figure

from cogrip.results.plots.coherence import coherence
from cogrip.results.plots.energy import energies
from cogrip.results.plots.motion import forces, positions, waves
from cogrip.results.plots.scene import bodies, contacts
from cogrip.results.plots.timing import link, loops
from cogrip.results.reading.traces import TracedRun


class Plot(NamedTuple):
    """File name, heading, function (NotDrawnError says why there is nothing to draw), and what to look for.

    scene: for scenes alone; other runs have no such plot, and no word on it.
    """

    name: str
    heading: str
    draw: Callable[[TracedRun], Figure]
    caption: str
    scene: bool = False


PLOTS = (
    Plot(
        "positions", "Positions", positions,
        "Each hand, the proxy that stands for it at the object, and the object: the gap between hand and proxy is what "
        "line and spring give way, and it should close when nobody pushes. A bar at the head stands while a button is down.",
    ),
    Plot(
        "forces", "Forces", forces,
        "What each hand feels and what its proxy does to the object, which is the same curve shifted by the delay: "
        "look for swings that grow, and for a bar at the foot, where the force was held back.",
    ),
    Plot(
        "bodies", "Bodies", bodies,
        "Where each body of the scene is, from where it began, and by how much it is turned: what is held should stay where "
        "the hands are, and a body that turns in them hangs below the line between them.", True,
    ),
    Plot(
        "contacts", "Contact forces and slip", contacts,
        "The normal force at each tool, its friction, and how far it has slipped along the body that it touches: what is held "
        "by friction begins to slip where friction reaches the normal force times the coefficient of friction.", True,
    ),
    Plot(
        "waves", "Waves", waves,
        "What each hand sends into the line and what comes back to it. A curve that fades away and returns is concealment of "
        'frames that did not come in time; with `playout.concealment` "zero" it drops to zero.',
    ),
    Plot(
        "energy", "Energy", energies,
        "Left, where the work of each hand goes; right, the energy reserve of each line, put in less taken "
        "out: 0 where all that was put in has come out, and a curve that enters the red has given out what nobody put in.",
    ),
    Plot(
        "link", "Link", link,
        "How long an answer takes, median and spread, and how many frames were not there when their time came: "
        "a spike is one that came after all, too late; a step that stays is one lost for good.",
    ),
    Plot(
        "loops", "Loops", loops,
        "How late the ticks came and how long the work of each took: a tick that would come more than a period late, "
        "right of the dotted line, is skipped, and counted in the legend.",
    ),
    Plot(
        "coherence", "Coherence", coherence,
        "How far the hands move as one, frequency by frequency: trust it above the dashed level, "
        "and where the lower panel shows that the hands do move.",
    ),
)  # fmt: skip
