"""Pages of a study's participants: what each shows, and where none is served, nothing."""

import os
from collections.abc import Collection, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import msgspec
from rich.console import Console

from cogrip.cli.terminal.problem import Problem
from cogrip.experiments.study.audio import Audio
from cogrip.experiments.study.questions import MOST_TEXT, TLX_MOST, TLX_STEP, Item
from cogrip.experiments.study.study_file import Study
from cogrip.view.io.process import ListeningError, open_browser
from cogrip.view.io.study_page import StudyPage, new_token
from cogrip.view.panel import GoalPlace, PanelMessage, PanelState, Prompt, Sound

FILE = "pages.json"  # file of port and tokens, beside the key of the server: tabs find the page again after a crash


SILENT = Audio()


class _Kept(msgspec.Struct):
    """Content of FILE."""

    port: Annotated[int, msgspec.Meta(ge=0, le=65535)] = 0
    tokens: dict[str, str] = msgspec.field(default_factory=dict)


class Pages:
    """Pages of all participants. None for `page`: there are none, and nobody ever replies."""

    def __init__(self, page: StudyPage | None = None, audio: Audio = SILENT) -> None:
        self.page = page
        self._audio = audio
        self._tones: dict[str, int] = {}  # phases that have begun, by person
        self._title: dict[str, str] = {}
        self._text: dict[str, str] = {}

    def title(self, people: Sequence[str], title: str) -> None:
        """Show these people another title from now on."""
        self._title.update(dict.fromkeys(people, title))

    def instruct(self, people: Sequence[str], text: str) -> None:
        """Show these people other instructions from now on."""
        self._text.update(dict.fromkeys(people, text))

    def show(self, person: str, state: PanelState, prompt: Prompt | None = None) -> None:
        """Show a person a state of the trial, and a prompt."""
        if self.page is not None:
            title, text = self._title.get(person, ""), self._text.get(person, "")
            message = PanelMessage(person, state, title, text, prompt=prompt, sound=self._sound(person))
            self.page.panel(person).show(message)

    def aim(self, people: Sequence[str], place_m: Sequence[float], within_m: float) -> None:
        """Show these people where the object is to be."""
        for person in people if self.page is not None else ():
            assert self.page is not None
            self.page.panel(person).change(target=GoalPlace(tuple(place_m), within_m))

    def cue(self, people: Sequence[str], text: str) -> None:
        """Show these people the cue of a phase, until the next one or until anything else is shown, with its tone."""
        for person in people if self.page is not None else ():
            assert self.page is not None
            self._tones[person] = self._tones.get(person, 0) + 1
            self.page.panel(person).change(cue=text, sound=self._sound(person))

    def _sound(self, person: str) -> Sound | None:
        audio = self._audio
        if not audio.wanted:
            return None
        levels = audio.tone_hz, audio.tone_s, audio.tone_level, audio.noise, audio.noise_level
        return Sound(*levels, tones=self._tones.get(person, 0))

    def take(self, person: str) -> str | None:
        """Return a person's reply to the prompt, None while there is none."""
        return None if self.page is None else self.page.panel(person).take()


def prompt_of(item: Item, problem: str = "") -> Prompt:
    """Return the prompt of a question. problem: why the last answer was not taken."""
    question = item.question
    match question.kind:
        case "choice":
            return Prompt(kind="choice", text=item.text, choices=question.choices, problem=problem)
        case "likert":
            return Prompt(
                kind="scale", text=item.text, least=1, most=question.points, low=question.low, high=question.high,
                problem=problem,
            )  # fmt: skip
        case "tlx":
            return Prompt(kind="scale", text=item.text, most=TLX_MOST, step=TLX_STEP, problem=problem)
        case "text":
            return Prompt(kind="text", text=item.text, most=MOST_TEXT, problem=problem)


def open_page(
    study: Study, folder: Path, hands: Collection[str], groups: Sequence[int], console: Console, stack: ExitStack
) -> StudyPage:
    """Serve the page with port and tokens of last time, until `stack` is closed; print addresses of those who come now.

    Raises Problem where no port is to be had, OSError where port and tokens cannot be kept.
    """
    everybody, state = study.groups(), folder / "state"
    kept = _read(state / FILE)
    tokens = {name: kept.tokens.get(name) or new_token() for group in everybody for name in group}
    page = StudyPage(study.name, tokens, hands, kept.port)
    stack.callback(_report, page, console)
    with Problem.of(ListeningError):
        stack.enter_context(page)
    _keep(state, page)
    for name in [name for group in groups for name in everybody[group]]:
        console.print(f"page of {name}: {page.address(name)}")
        open_browser(page.address(name))
    return page


def _report(page: StudyPage, console: Console) -> None:
    """Print what was refused at the pages, once they are closed."""
    if counts := {name: count for name, count in sorted(page.counts.items()) if count}:
        console.print("pages: " + ", ".join(f"{name} {count}" for name, count in counts.items()))


def _keep(state: Path, page: StudyPage) -> None:
    """Write port and tokens of a page that is served. Raises OSError."""
    state.mkdir(mode=0o700, parents=True, exist_ok=True)
    part = state / f"{FILE}.part"
    part.unlink(missing_ok=True)
    with open(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(msgspec.json.encode(_Kept(page.port, page.tokens)))
    part.replace(state / FILE)


def _read(path: Path) -> _Kept:
    try:
        return msgspec.json.decode(path.read_bytes(), type=_Kept)
    except (OSError, msgspec.MsgspecError):
        return _Kept()
