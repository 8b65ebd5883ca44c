"""Questions to participants: choice, Likert, NASA-TLX, free text; and which answers they take.

NASA-TLX: Hart and Staveland 1988, six scales of 21 gradations, here 0 to 100 in steps of 5; the raw score is their mean (Hart
2006).
"""

from collections.abc import Sequence
from typing import Annotated, Any, Literal
from unicodedata import category

import msgspec

from cogrip.machine.addition import add_floats

TLX_SCALES = {
    "mental_demand": "How mentally demanding was the task?",
    "physical_demand": "How physically demanding was the task?",
    "temporal_demand": "How hurried or rushed was the pace of the task?",
    "performance": "How successful were you in accomplishing what you were asked to do? (0 perfect, 100 failure)",
    "effort": "How hard did you have to work to accomplish your level of performance?",
    "frustration": "How insecure, discouraged, irritated, stressed and annoyed were you?",
}
TLX_STEP, TLX_MOST = 5, 100
MOST_TEXT = 10_000

Answer = int | str


class AnswerError(ValueError):
    """An answer that a question does not take; the text says what it takes."""


class Question(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[questions.NAME]. choices: of a choice; points, low, high: of a Likert scale, 1 to `points`, and words at its ends."""

    kind: Literal["choice", "likert", "tlx", "text"]
    text: str = ""
    choices: tuple[str, ...] = ()
    points: Annotated[int, msgspec.Meta(ge=2, le=11)] = 7
    low: str = ""
    high: str = ""


class Item(msgspec.Struct, frozen=True):
    """One thing to answer: a question, or one scale of a NASA-TLX. name: of its column."""

    name: str
    text: str
    question: Question

    @property
    def takes(self) -> str:
        """Return what may be answered, for a person."""
        match self.question.kind:
            case "choice":
                choices = self.question.choices
                if _numbers(choices):  # a number is an answer then, and not the place of one
                    return ", ".join(choices)
                return ", ".join(f"{number} {choice}" for number, choice in enumerate(choices, 1))
            case "likert":
                question = self.question
                ends = f" ({question.low} to {question.high})" if question.low or question.high else ""
                return f"1 to {question.points}{ends}"
            case "tlx":
                return f"0 to {TLX_MOST} in steps of {TLX_STEP}"
            case "text":
                return "any text"

    def read(self, text: str) -> Answer:
        """Return the answer that was typed. Raises AnswerError."""
        text = text.strip()
        match self.question.kind:
            case "choice":
                choices = self.question.choices
                if text in choices:
                    return text
                if _numbers(choices):
                    raise self._refused(text)
                return choices[self._number(text, 1, len(choices)) - 1]
            case "likert":
                return self._number(text, 1, self.question.points)
            case "tlx":
                number = self._number(text, 0, TLX_MOST)
                if number % TLX_STEP:
                    raise self._refused(text)
                return number
            case "text":
                if len(text) > MOST_TEXT:
                    raise AnswerError(f"the answer has {len(text)} letters; at most {MOST_TEXT} are kept")
                if control := next((each for each in text if category(each) == "Cc" and each not in "\t\n\r"), ""):
                    raise AnswerError(f"the answer has a control character (U+{ord(control):04X}); leave it out")
                return text

    def _number(self, text: str, least: int, most: int) -> int:
        try:
            number = int(text)
        except ValueError:
            raise self._refused(text) from None
        if not least <= number <= most:
            raise self._refused(text)
        return number

    def _refused(self, text: str) -> AnswerError:
        return AnswerError(f"{text[:40]!r} is no answer here; give {self.takes}")


def _numbers(choices: Sequence[str]) -> bool:
    """Return whether a choice reads as a number, so that places would be taken for it."""
    return any(choice.strip().lstrip("+-").isdigit() for choice in choices)


def items_of(name: str, question: Question) -> tuple[Item, ...]:
    """Return the items of a question: six of a NASA-TLX, else one."""
    if question.kind == "tlx":
        return tuple(Item(f"{name}_{scale}", text, question) for scale, text in TLX_SCALES.items())
    return (Item(name, question.text, question),)


def unfit_question(question: Question) -> str:
    """Return why a question cannot be asked, "" if it can."""
    if question.kind == "choice" and len(set(question.choices)) < 2:
        return f"a choice needs two different choices at least; got choices = {list(question.choices)}"
    if question.kind != "choice" and question.choices:
        return f'choices are for kind = "choice"; got kind = "{question.kind}"; leave them out'
    if question.kind != "tlx" and not question.text:
        return "has no text; give text"
    return ""


def raw_tlx(answers: dict[str, Any], name: str) -> float | None:
    """Return the raw NASA-TLX, 0 to 100: the mean of the six scales; None where one is missing."""
    found = [answers.get(f"{name}_{scale}") for scale in TLX_SCALES]
    return None if None in found else add_floats(map(float, found)) / len(found)  # type: ignore[arg-type]
