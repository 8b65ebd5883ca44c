"""A page in a real browser that draws in software: `python page.py URL SECONDS`.

Prints after SECONDS of pictures what the page measured of that time, as JSON: pictures in each second, and of the newest frames
their numbers and when the browser had taken their pictures [s, of the system's clock]; or what is `missing` here.
"""

import json
import sys

from tests.view.browser_page import BrowserPage
from tests.view.browser_program import NoBrowserError, launched

CLOCK_OFF_MS = """async () => {
  const off = [];
  for (let each = 0; each < 50; each += 1) {
    const before = Date.now();
    while (Date.now() === before);
    off.push(Date.now() - performance.timeOrigin - performance.now());
    await new Promise((resolve) => setTimeout(resolve, 3));
  }
  return off.sort((a, b) => a - b)[25];
}"""
"""Offset of the page's own clock from the system's, which it knows by the millisecond: seen as that changes."""


def measure(url: str, seconds: float) -> dict[str, object]:
    """Return what the page at `url` measures in `seconds`, after its first frame."""
    with launched() as browser:
        page = BrowserPage(browser, url)
        page.until("cogrip.stats.drawn > 60")
        rates = []
        for _ in range(max(1, round(seconds))):
            page.tab.wait_for_timeout(1000)
            rates.append(page.state("cogrip.stats.fps"))
        drawn = [each for each in page.state("cogrip.stats.recent") if each["drawn_ms"] > 0]  # not yet: null or NaN
        off_ms = page.state(f"({CLOCK_OFF_MS})()")
        people = page.state("cogrip.frame.people.length")
        page.close()
    times_s = [(each["number"], (each["drawn_ms"] + off_ms) / 1e3) for each in drawn]
    return {"fps": rates, "people": people, "drawn": times_s}


if __name__ == "__main__":
    try:
        print(json.dumps(measure(sys.argv[1], float(sys.argv[2]))))
    except NoBrowserError as error:
        print(json.dumps({"missing": str(error)}))
