"""A run's report in a real browser, on a phone and in the dark."""

import pytest

from cogrip.results.report.page import write_report

from tests.view.browser_page import BrowserPage, Open
from tests.view.recorded_runs import recorded_run


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_report(recorded_run(tmp_path_factory.mktemp("runs") / "run", 1.0)).as_uri()


def width_of(page: BrowserPage, selector: str) -> float:
    return float(page.state(f"document.querySelector('{selector}').getBoundingClientRect().width"))


def test_on_a_phone_plots_keep_their_size_and_settings_are_whole(open_page: Open, report: str) -> None:
    page = open_page(report, width=400)
    assert width_of(page, "figure img") > 700.0, "their letters can be read, and they move sideways"
    assert page.state("document.documentElement.scrollWidth") <= 400
    assert page.state("[...document.querySelectorAll('.wide')].at(-1).scrollWidth") <= 400, (
        "hands of two people are not cut"
    )


@pytest.mark.parametrize(("scheme", "bright"), [("dark", False), ("light", True)])
def test_plots_follow_the_system(open_page: Open, report: str, scheme: str, bright: bool) -> None:
    page = open_page(report, color_scheme=scheme)
    page.state("document.querySelector('figure img').scrollIntoView()")
    assert (float(page.picture()[:300].mean()) > 0.5) == bright


def test_code_is_shown_as_code(open_page: Open, report: str) -> None:
    page = open_page(report)
    words = page.state("document.body.innerText")
    assert "`" not in words
    assert page.text("figcaption code") == "playout.concealment"
    assert "not measured" not in page.state("[...document.querySelectorAll('td')].map((each) => each.textContent)")
