"""The live table of this system: it needs a terminal with job control, which Windows has not."""

import sys

if sys.platform == "win32":
    from cogrip.cli.terminal.plain_screen import LiveScreen, draw_below, may_draw
else:
    from cogrip.cli.terminal.live_screen import LiveScreen, draw_below, may_draw

__all__ = ["LiveScreen", "draw_below", "may_draw"]
