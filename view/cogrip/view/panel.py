"""Panel of one participant on the page of a study: what it says, its target, one prompt, and the reply (`docs/view.md`).

The study shows and takes, in its own thread; tabs enter, leave and reply in the page's. What each writes is one value, whole.
"""

from collections.abc import Callable
from typing import Literal

import msgspec
from msgspec.structs import replace

from cogrip.view.tab import Tab

PanelState = Literal["waiting", "running", "asking", "paused", "over"]


class GoalPlace(msgspec.Struct, frozen=True):
    """A goal's place: where the object's is to be, within that distance, on the axes that are given."""

    place_m: tuple[float, ...]
    within_m: float


class Prompt(msgspec.Struct, frozen=True, kw_only=True):
    """A question, or "go": a button. number: replies name it; choices: of a choice; least to most in steps: of a scale."""

    kind: Literal["go", "choice", "scale", "text"]
    text: str
    number: int = 0
    choices: tuple[str, ...] = ()
    least: int = 0
    most: int = 0  # of a text: letters
    step: int = 1
    low: str = ""
    high: str = ""
    problem: str = ""  # why the last reply was not taken


class Sound(msgspec.Struct, frozen=True):
    """Sounds of a page: of `tones` the newest begins a phase, noise goes on while the state is running.

    Levels are of full scale; 0 Hz is no tone.
    """

    tone_hz: float = 0.0
    tone_s: float = 0.15
    tone_level: float = 0.2
    noise: Literal["none", "white", "pink"] = "none"
    noise_level: float = 0.1
    tones: int = 0


class PanelMessage(msgspec.Struct, frozen=True, tag_field="type", tag="panel"):
    """A panel as a page shows it."""

    person: str
    state: PanelState = "waiting"
    title: str = ""
    text: str = ""
    cue: str = ""  # of the phase of the trial that is going on
    target: GoalPlace | None = None
    prompt: Prompt | None = None
    sound: Sound | None = None


class Panel:
    """See above. late: replies to prompts that are not open any more, or have a reply."""

    def __init__(self, person: str, changed: Callable[[], None] = lambda: None, number: int = 0) -> None:
        """changed: called from any thread when tabs are to be told; number: that the first prompt follows.

        A tab outlives the command: `number` by chance keeps it from answering the prompt of another one, begun anew.
        """
        self.message = PanelMessage(person)
        self.late = 0
        self._changed = changed
        self._tabs: set[Tab] = set()
        self._number = number
        self._reply: tuple[int, str] | None = None  # to the prompt of that number

    def show(self, message: PanelMessage) -> None:
        """Show something else. A prompt gets a number of its own: a reply to the one before does not count any more."""
        if message.prompt is not None:
            self._number += 1
            message = replace(message, prompt=replace(message.prompt, number=self._number))
        self.message = message
        self._changed()

    def change(self, *, target: GoalPlace | None = None, cue: str | None = None, sound: Sound | None = None) -> None:
        """Show another target, cue or sound, and leave the rest."""
        message = self.message
        cue = message.cue if cue is None else cue
        self.message = replace(message, target=target or message.target, cue=cue, sound=sound or message.sound)
        self._changed()

    def take(self) -> str | None:
        """Return the reply to the prompt, once; None while there is none."""
        prompt, reply = self.message.prompt, self._reply
        if prompt is None or reply is None or reply[0] != prompt.number:
            return None
        self.message = replace(self.message, prompt=None)
        return reply[1]

    def reply(self, number: int, text: str) -> None:
        """Take a tab's reply. The first one to a prompt counts."""
        prompt = self.message.prompt
        if prompt is None or prompt.number != number or (self._reply is not None and self._reply[0] == number):
            self.late += 1
        else:
            self._reply = number, text

    def enter(self, tab: Tab) -> None:
        """Tell a tab that was opened, and from now on."""
        self._tabs.add(tab)
        tab.say(self.text())

    def leave(self, tab: Tab) -> None:
        """Tell a tab no more."""
        self._tabs.discard(tab)

    def tell(self) -> None:
        """Tell all tabs; in their thread."""
        text = self.text()
        for tab in self._tabs:
            tab.say(text)

    def text(self) -> str:
        """Return the panel as a text message."""
        return msgspec.json.encode(self.message).decode()
