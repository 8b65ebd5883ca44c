"""Draw docs/pictures/architecture.svg and .png: processes, threads and rates of a session, and what crosses the network.

usage: python docs/figures/architecture.py [FOLDER]
"""

import sys
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

FOLDER = Path(__file__).resolve().parents[1] / "pictures"
NAME = "architecture"
WIDTH_IN, HEIGHT_IN, DPI = 11.0, 6.7, 130
INK, FAINT, PAPER = "#1f2328", "#57606a", "#ffffff"
CLIENT, SERVER, NETWORK, OTHER = "#0072B2", "#009E73", "#D55E00", "#57606a"


class Drawing:
    """Boxes and arrows on a page of 110 by 67 units."""

    def __init__(self) -> None:
        self.figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), dpi=DPI, facecolor=PAPER)
        FigureCanvasAgg(self.figure)
        self.axes: Axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set(xlim=(0.0, 110.0), ylim=(0.0, 67.0))
        self.axes.axis("off")
        self.words: list[str] = []

    def text(self, x: float, y: float, words: str, size: float = 8.5, colour: str = INK, **style: str | float) -> None:
        """Write words beside (x, y), or around it with ha="center"."""
        self.words.append(words)
        self.axes.text(x, y, words, {"fontsize": size, "color": colour, "va": "center", "linespacing": 1.35, **style})

    def process(self, x: float, y: float, width: float, height: float, title: str, colour: str) -> None:
        """Draw the border of a process with its title inside at the top."""
        self._patch(x, y, width, height, colour, f"{colour}14", 1.6)
        self.text(x + 1.4, y + height - 2.0, title, 9.5, colour, weight="bold")

    def box(
        self, x: float, y: float, width: float, height: float, words: str, colour: str, turned: float = 0.0
    ) -> None:
        """Draw a part of a process."""
        self._patch(x, y, width, height, colour, PAPER, 1.0)
        self.text(x + width / 2.0, y + height / 2.0, words, ha="center", rotation=turned)

    def arrow(self, start: tuple[float, float], end: tuple[float, float], colour: str, both: bool = False) -> None:
        """Draw an arrow to `end`, or to both ends."""
        style = "<|-|>" if both else "-|>"
        patch = FancyArrowPatch(
            start, end, arrowstyle=style, mutation_scale=11, lw=1.5, color=colour, shrinkA=0.0, shrinkB=0.0
        )
        self.axes.add_patch(patch)

    def _patch(self, x: float, y: float, width: float, height: float, edge: str, face: str, line: float) -> None:
        shape = "round,pad=0,rounding_size=0.9"
        self.axes.add_patch(FancyBboxPatch((x, y), width, height, boxstyle=shape, ec=edge, fc=face, lw=line))


def draw() -> Drawing:
    """Return the finished drawing."""
    drawing = Drawing()
    _client(drawing)
    _network(drawing)
    _server(drawing)
    _other_processes(drawing)
    return drawing


def _client(drawing: Drawing) -> None:
    drawing.process(2.0, 22.0, 44.0, 43.0, "client process, one for each person", CLIENT)
    drawing.text(3.4, 60.3, "one thread: loop at 1024 Hz, a datagram every 8 ticks", colour=FAINT)
    drawing.box(4.0, 51.5, 17.0, 6.5, "device driver\nposition in, force out", CLIENT)
    drawing.box(4.0, 38.5, 17.0, 9.0, "safety, device port\nclamp, slope, ramp,\nenergy ledger", CLIENT)
    drawing.box(4.0, 24.0, 17.0, 10.5, "coupling\nwave transformation,\nvelocity estimate", CLIENT)
    drawing.box(24.5, 38.5, 13.0, 9.0, "receiver\njitter buffer,\nconcealment", CLIENT)
    drawing.box(24.5, 24.0, 13.0, 9.0, "sender\nmean of 8 ticks,\nredundancy", CLIENT)
    drawing.box(40.5, 24.0, 3.6, 23.5, "emulated links, both directions", NETWORK, 90.0)
    drawing.arrow((12.5, 47.5), (12.5, 51.5), CLIENT, both=True)
    drawing.arrow((12.5, 34.5), (12.5, 38.5), CLIENT, both=True)
    drawing.arrow((21.0, 28.5), (24.5, 28.5), CLIENT)
    drawing.arrow((25.2, 38.5), (21.0, 33.0), CLIENT)
    drawing.arrow((37.5, 28.5), (40.5, 28.5), NETWORK)
    drawing.arrow((40.5, 43.0), (37.5, 43.0), NETWORK)


def _network(drawing: Drawing) -> None:
    drawing.text(57.0, 61.5, "UDP datagrams", 9.5, NETWORK, weight="bold", ha="center")
    drawing.text(57.0, 57.3, "DTLS-encrypted\nbeyond loopback", colour=FAINT, ha="center")
    drawing.text(57.0, 48.3, "returning waves, object:\n128 a second to each seat", ha="center")
    drawing.arrow((70.0, 43.0), (44.1, 43.0), NETWORK)
    drawing.text(57.0, 39.3, "to observers: views,\nat most 32 a second", colour=FAINT, ha="center")
    drawing.text(57.0, 32.9, "forward waves, position:\n128 a second", ha="center")
    drawing.arrow((44.1, 28.5), (70.0, 28.5), NETWORK)
    drawing.text(57.0, 24.6, "8 newest frames and\nrunning totals in each", colour=FAINT, ha="center")


def _server(drawing: Drawing) -> None:
    drawing.process(68.0, 22.0, 40.0, 43.0, "server process", SERVER)
    drawing.text(69.4, 60.3, "one thread: each room at 128 Hz", colour=FAINT)
    drawing.box(
        70.0,
        51.5,
        36.0,
        6.5,
        "session: seats, tokens, observers, rate limits,\nresume after a silence or a new address",
        SERVER,
    )
    drawing.box(70.0, 24.0, 3.6, 23.5, "one socket, all rooms", NETWORK, 90.0)
    drawing.box(77.0, 38.5, 13.0, 9.0, "sender\none for each\nseat", SERVER)
    drawing.box(77.0, 24.0, 13.0, 9.0, "receiver\njitter buffer,\nconcealment", SERVER)
    drawing.box(93.5, 24.0, 12.5, 23.5, "world\n\nobject and all\nsprings in one\nimplicit step", SERVER)
    drawing.arrow((73.6, 28.5), (77.0, 28.5), NETWORK)
    drawing.arrow((77.0, 43.0), (73.6, 43.0), NETWORK)
    drawing.arrow((90.0, 28.5), (93.5, 28.5), SERVER)
    drawing.arrow((93.5, 43.0), (90.0, 43.0), SERVER)


def _other_processes(drawing: Drawing) -> None:
    drawing.process(2.0, 2.0, 22.0, 13.0, "recorder process", OTHER)
    drawing.text(3.4, 10.8, "writes client-NAME.mcap,\ninputs and outputs of\nthe core", colour=FAINT, va="top")
    drawing.process(27.0, 2.0, 19.0, 13.0, "live table process", OTHER)
    drawing.text(28.4, 10.8, "reads the recording,\ndraws below the lines\nof the terminal", colour=FAINT, va="top")
    drawing.process(48.5, 2.0, 17.0, 13.0, "relay process", NETWORK)
    drawing.text(49.9, 10.8, "optional: emulates\na network between\nany two programs", colour=FAINT, va="top")
    drawing.process(68.0, 2.0, 18.5, 13.0, "recorder process", OTHER)
    drawing.text(69.4, 10.8, "writes server.mcap,\nall rooms", colour=FAINT, va="top")
    drawing.process(89.0, 2.0, 19.0, 13.0, "metrics process", OTHER)
    drawing.text(90.4, 10.8, "/metrics and /healthz\non 127.0.0.1", colour=FAINT, va="top")
    drawing.arrow((8.0, 22.0), (8.0, 15.0), OTHER)
    drawing.text(9.2, 18.5, "ring in shared memory", colour=FAINT)
    drawing.arrow((24.0, 8.5), (27.0, 8.5), OTHER)
    drawing.arrow((72.0, 22.0), (72.0, 15.0), OTHER)
    drawing.text(73.2, 18.5, "ring", colour=FAINT)
    drawing.arrow((93.0, 22.0), (93.0, 15.0), OTHER)
    drawing.text(94.2, 18.5, "snapshots", colour=FAINT)
    drawing.arrow((57.0, 22.0), (57.0, 15.0), NETWORK, both=True)


def write(folder: Path) -> list[Path]:
    """Write both files, the same bytes for the same matplotlib; return their paths."""
    paths = [folder / f"{NAME}.svg", folder / f"{NAME}.png"]
    with mpl.rc_context({"svg.hashsalt": NAME, "svg.fonttype": "path", "font.family": "DejaVu Sans"}):
        figure = draw().figure
        figure.savefig(paths[0], metadata={"Date": None, "Creator": None})
        figure.savefig(paths[1], metadata={"Software": None})
    return paths


if __name__ == "__main__":
    for written in write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER):
        print(written)
