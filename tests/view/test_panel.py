"""Panel of a study's participant: prompts and replies; and a page that shows it, of a server that the test speaks for."""

import json
import socket
from contextlib import ExitStack
from io import StringIO
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from cogrip.cli.study.pages import open_page as serve_pages
from cogrip.cli.study.pages import prompt_of
from cogrip.experiments.study.questions import MOST_TEXT, Question, items_of
from cogrip.view.frames import encode
from cogrip.view.hello import MOST_NUMBER, PageError, PanelReply, read_text
from cogrip.view.io.study_page import StudyPage
from cogrip.view.panel import GoalPlace, Panel, PanelMessage, Prompt
from cogrip.view.tab import Tab

from tests.experiments.studies import PLAIN, parsed
from tests.view.browser_page import BrowserPage, Show, Shown
from tests.view.page_server import PageServer
from tests.view.pictured import frame, scene

GO = Prompt(kind="go", text="I am ready")
QUESTIONS = {
    "choice": Question("choice", "Which?", choices=("left", "<b>right</b>")),
    "likert": Question("likert", "How?", points=5, low="bad", high="good"),
    "tlx": Question("tlx"),
    "text": Question("text", "Why?"),
}


def asking(prompt: Prompt | None, **more: object) -> PanelMessage:
    return PanelMessage("P01", "asking", prompt=prompt, **more)  # type: ignore[arg-type]


@given(st.lists(st.tuples(st.sampled_from(["show", "take", "reply"]), st.integers(0, 5), st.text(max_size=3))))
def test_every_prompt_has_the_first_reply_to_it_or_none(steps: list[tuple[str, int, str]]) -> None:
    """The panel against its definition: a prompt's own first reply, given back once, and all others counted."""
    panel = Panel("P01")
    number, first, taken, late = 0, None, False, 0
    for verb, named, text in steps:
        if verb == "show":
            panel.show(asking(GO))
            number, first, taken = number + 1, None, False
        elif verb == "take":
            assert panel.take() == (None if taken else first)
            taken = taken or first is not None
        else:
            panel.reply(named, text)
            if number and named == number and first is None and not taken:
                first = text
            else:
                late += 1
    assert panel.late == late


def test_a_reply_to_a_prompt_of_the_command_before_does_not_count() -> None:
    """A tab stays open over a kill: the question that it shows has another number than any of the command begun anew."""
    before, again = (StudyPage("study", {"P01": "token"}).panel("P01") for _ in range(2))
    numbers = []
    for panel in (before, again):
        panel.show(asking(GO))
        assert panel.message.prompt is not None
        numbers.append(panel.message.prompt.number)
    assert 0 < numbers[0] != numbers[1] <= MOST_NUMBER
    again.reply(numbers[0], "5")
    assert (again.take(), again.late) == (None, 1)
    again.reply(numbers[1], "6")
    assert again.take() == "6"


def test_tab_that_comes_later_is_told_the_open_prompt() -> None:
    panel = Panel("P01")
    panel.show(asking(GO, title="trial 3"))
    tab = Tab(lambda: None)
    panel.enter(tab)
    (said,) = tab.take()
    assert json.loads(said) == {
        "type": "panel", "person": "P01", "state": "asking", "title": "trial 3", "text": "", "cue": "", "target": None,
        "prompt": {**msgspec.to_builtins(GO), "number": 1, "choices": []}, "sound": None,
    }  # fmt: skip
    panel.leave(tab)
    panel.tell()
    assert tab.take() == []


def test_reply_is_bounded() -> None:
    longest = "x" * MOST_TEXT
    assert read_text(json.dumps({"type": "reply", "number": 1, "text": longest})) == PanelReply(1, longest)
    for wrong in ({"text": "x" * (MOST_TEXT + 1)}, {"number": -1}, {"number": 2**31}, {"text": None}, {"more": 1}):
        with pytest.raises(PageError):
            read_text(json.dumps({"type": "reply", "number": 1, "text": "x"} | wrong))


class Asked:
    """The page, and the panel that is told to it."""

    def __init__(self, page: BrowserPage, server: PageServer) -> None:
        self.page, self.server, self.panel = page, server, Panel("P01")

    def show(self, message: PanelMessage) -> None:
        self.panel.show(message)
        self.server.send(self.panel.text())
        number = message.prompt and self.panel.message.prompt
        self.page.until("document.querySelector('#panel [data-part=title]').textContent.startsWith('P01')")
        if number and message.prompt and message.prompt.kind != "go":
            self.page.until(
                f"document.querySelector('#panel legend')?.textContent === {json.dumps(message.prompt.text)}"
            )

    def reply(self) -> str:
        """Return what the panel takes of the page's next message."""
        said = read_text(self.server.said.get(timeout=20.0))
        assert isinstance(said, PanelReply)
        self.panel.reply(said.number, said.text)
        text = self.panel.take()
        assert text is not None
        return text


@pytest.fixture(scope="module")
def opened(show_shared: Show) -> Shown:
    return show_shared(scene())


@pytest.fixture
def asked(opened: Shown) -> Asked:
    opened[1].come_again()
    return Asked(*opened)


def press(asked: Asked, name: str) -> None:
    asked.page.tab.get_by_role("button", name=name, exact=True).click()


def test_every_kind_of_question_is_answered_as_at_the_terminal(asked: Asked) -> None:
    choice, likert, tlx, text = (items_of("q", QUESTIONS[kind])[0] for kind in ("choice", "likert", "tlx", "text"))
    asked.show(asking(prompt_of(choice)))
    press(asked, "<b>right</b>")
    assert choice.read(asked.reply()) == "<b>right</b>"
    asked.show(asking(prompt_of(likert)))
    assert "bad" in asked.page.text("#panel .ends")
    press(asked, "4")
    assert likert.read(asked.reply()) == 4
    asked.show(asking(prompt_of(tlx)))
    slider = asked.page.tab.locator("#panel input")
    assert asked.page.tab.get_by_role("button", name="Send").is_disabled(), "nothing is chosen yet"
    slider.focus()
    for _ in range(3):
        asked.page.tab.keyboard.press("ArrowRight")
    press(asked, "Send 65")
    assert tlx.read(asked.reply()) == 65
    asked.show(asking(prompt_of(text)))
    asked.page.tab.keyboard.type("a t?g <i>7</i>")  # keys of the picture and of the hand, elsewhere
    asked.page.tab.keyboard.press("Enter")
    asked.page.tab.keyboard.type("ü")
    assert not asked.page.state("document.getElementById('help').open")
    press(asked, "Send")
    assert text.read(asked.reply()) == "a t?g <i>7</i>\nü"


def test_key_says_ready_once(asked: Asked) -> None:
    asked.show(asking(GO))
    asked.page.until("document.querySelector('#panel button')?.textContent === 'I am ready'")
    asked.page.tab.keyboard.press("Enter")
    asked.page.tab.keyboard.press("Enter")
    assert asked.reply() == ""
    assert asked.server.said.empty()
    assert asked.page.tab.get_by_role("button", name="I am ready").is_disabled()


def test_draft_outlasts_a_break_and_texts_are_no_markup(asked: Asked) -> None:
    text = '<img src=x onerror="document.title=1"><script>document.title=2</script>'
    item = items_of("q", Question("text", text))[0]
    asked.show(asking(prompt_of(item, problem=text), title=text, text=text))
    asked.page.tab.keyboard.type("half a")
    asked.server.come_again()
    asked.server.send(asked.panel.text())
    asked.page.until("document.getElementById('status').hidden")
    asked.page.tab.locator("#panel textarea").press_sequentially(" sentence")
    press(asked, "Send")
    assert asked.reply() == "half a sentence"
    assert asked.page.state("document.querySelectorAll('#panel img, #panel script').length") == 0
    assert asked.page.text("#panel [data-part=text]") == text


@pytest.mark.parametrize(
    ("place_m", "size"),
    [((0.03,), [0.02, 0.2, 0.2]), ((0.03, 0.01), [0.02, 0.02, 0.2]), ((0.03, 0.0, 0.02), [0.02] * 3)],
)
def test_target_is_drawn_where_the_goal_is(asked: Asked, place_m: tuple[float, ...], size: list[float]) -> None:
    asked.show(PanelMessage("P01", "running", target=GoalPlace(place_m, 0.01)))
    asked.server.send(encode(frame(1)))
    asked.page.until(
        f"cogrip.frame?.drawn.target?.place[0] === 0.03 && cogrip.frame.drawn.target.size[2] === {size[2]}"
    )
    drawn = asked.page.state("cogrip.frame.drawn.target")
    assert drawn["size"] == pytest.approx(size)
    assert drawn["place"][: len(place_m)] == pytest.approx(list(place_m))
    asked.show(PanelMessage("P01", "waiting"))
    asked.page.until("cogrip.frame.drawn.target === null")


def test_pages_whose_port_is_none_get_another_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A port that no socket has would end the page's thread, unseen."""
    monkeypatch.setenv("BROWSER", "true")
    study = parsed(PLAIN)
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "pages.json").write_text('{"port": 70000, "tokens": {"P01": "token"}}')
    with ExitStack() as stack, Console(file=StringIO()) as console:
        page = serve_pages(study, tmp_path, (), [0], console, stack)
        with socket.create_connection(("127.0.0.1", page.port), 5.0):
            assert 0 < page.port <= 65535


def test_a_cue_is_shown_until_the_next_one_or_until_the_trial_is_over(asked: Asked) -> None:
    shown = "document.querySelector('#panel [data-part=cue]')"
    asked.show(PanelMessage("P01", "running", title="trial 3", text="Hold still."))
    target = GoalPlace((0.04,), 0.01)
    asked.panel.change(target=target)
    for cue in ("Get <b>ready</b>", "Push now", ""):
        asked.panel.change(cue=cue)
        assert (asked.panel.message.cue, asked.panel.message.target, asked.panel.message.text) == (
            cue,
            target,
            "Hold still.",
        )
        asked.server.send(asked.panel.text())
        asked.page.until(f"{shown}.textContent === {json.dumps(cue)}")
        visible = asked.page.tab.evaluate(f"getComputedStyle({shown}).display !== 'none'")
        assert visible is bool(cue)
    asked.panel.change(cue="Push now")
    asked.show(PanelMessage("P01", "waiting"))
    asked.page.until(f"{shown}.textContent === ''")
