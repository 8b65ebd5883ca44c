"""A page in a real browser, as the tests handle it."""

from collections.abc import Callable, Sequence
from io import BytesIO
from typing import Any

import matplotlib.image
import numpy as np

from tests.view.page_server import PageServer

PATIENCE_MS = 10_000
WATCH_POLICY = (
    "addEventListener('securitypolicyviolation', (event) => console.error('policy', event.violatedDirective))"
)
# Playwright's own wait would call eval, which the page's policy forbids.
UNTIL = """async () => {
  const end = performance.now() + PATIENCE_MS;
  while (!(CONDITION)) {
    if (performance.now() > end) throw new Error("never came true");
    await new Promise((resolve) => setTimeout(resolve, 5));
  }
}"""
NOT_OURS = ("GL Driver Message", "WebSocket connection to")  # the second: a server that ended before the page


class BrowserPage:
    """`errors`: all that went wrong in the page: exceptions, what it logged as an error, broken policy.

    context: of a browser context of its own, what Playwright takes; without, it is a tab of the one that pages share
    """

    def __init__(
        self, browser: Any, address: str, width: int = 1280, height: int = 720, script: str = "", color_scheme: str = "light",
        **context: Any,
    ) -> None:  # fmt: skip
        self._own = bool(context)
        self.context = browser.new_context(**context) if self._own else browser.contexts[0]
        self.tab = self.context.new_page()
        self.tab.set_default_timeout(PATIENCE_MS)
        self.tab.set_viewport_size({"width": width, "height": height})
        self.tab.emulate_media(color_scheme=color_scheme)
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.on("console", self._heard)
        self.tab.on("request", lambda request: self.requests.append(request.url))
        self.tab.add_init_script(WATCH_POLICY + "\n" + script)
        self.tab.goto(address)

    def _heard(self, message: Any) -> None:
        if message.type == "error" and not any(each in message.text for each in NOT_OURS):
            self.errors.append(message.text)

    def state(self, expression: str) -> Any:
        return self.tab.evaluate(expression)

    def until(self, condition: str) -> None:
        """Wait until a JavaScript expression is true."""
        self.tab.evaluate(UNTIL.replace("CONDITION", condition).replace("PATIENCE_MS", str(PATIENCE_MS)))

    def until_drawn(self, number: int) -> dict[str, Any]:
        """Wait for the picture of a frame and return it, read back from the page."""
        self.until(f"cogrip.frame?.number === {number}")
        frame: dict[str, Any] = self.state("cogrip.frame")
        return frame

    def text(self, selector: str) -> str:
        return str(self.tab.locator(selector).first.inner_text())

    def picture(self) -> np.ndarray:
        """Return the page as it looks: rows, columns, red green blue from 0 to 1."""
        pixels: np.ndarray = matplotlib.image.imread(BytesIO(self.tab.screenshot()))[..., :3]
        return pixels

    def pixel(self, picture: np.ndarray, point: Sequence[float]) -> np.ndarray:
        """Return the colour where a point of the world is drawn."""
        column, row = self.state(f"cogrip.project({list(point)})")
        colour: np.ndarray = picture[round(row), round(column)]
        return colour

    def close(self) -> None:
        self.state("new Promise((resolve) => setTimeout(resolve))")  # what is still to be told comes before
        (self.context if self._own else self.tab).close()


Shown = tuple[BrowserPage, PageServer]
Open, Show = Callable[..., BrowserPage], Callable[..., Shown]
"""The fixtures `open_page` and `show`."""
