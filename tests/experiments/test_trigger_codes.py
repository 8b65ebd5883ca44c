"""Codes of a study's events: which there are, and which marker has which."""

import pytest

from cogrip.experiments.study.study_file import StudyError
from cogrip.experiments.study.trigger_codes import code_of, codes_of_run, words_of

from tests.experiments.studies import PLAIN, parsed

RUN = "01-001-one-1"


def test_a_marker_has_the_code_of_its_event() -> None:
    triggers = {"begin": 1, "end": 2, "end goal": 3, "phase push": 11, "marker lamp on": 50, "marker": 99}
    codes = codes_of_run(triggers, RUN)
    for marker, code in (
        (f"begin {RUN}", 1), (f"end {RUN} time", 2), (f"end {RUN} goal", 3), (f"phase {RUN} push", 11), ("lamp on", 50),
        ("anna lamp on", 50), ("lamp off", 99), (f"phase {RUN} rest", 99), ("begin 01-002-one-1", 99),
    ):  # fmt: skip
        assert code_of(codes, words_of(marker, ["anna", "ann"])) == code, marker
    assert code_of(codes_of_run({"begin": 1}, RUN), "lamp on") is None
    assert codes_of_run({}, RUN) == {}


def test_the_words_of_a_marker_are_those_that_the_line_is_told() -> None:
    """The line looks whole texts up: a marker whose end is another one's words has no code of that."""
    codes = codes_of_run({"marker go": 5, "marker let go": 6}, RUN)
    assert [code_of(codes, words_of(text, ["anna"])) for text in ("go", "let go", "anna go", "anna let go")] == [
        5,
        6,
        5,
        6,
    ]
    assert code_of(codes_of_run({"marker go": 5}, RUN), words_of("let go", ["anna"])) is None
    assert code_of(codes_of_run({"marker time": 7, "end time": 3}, RUN), f"end {RUN} time") == 3


@pytest.mark.parametrize(
    ("triggers", "words"),
    [({"begin": 0}, ">= 1"), ({"begin": 256}, "<= 255"), ({"start": 1}, "start: there is no such event; there is: begin, end"),
     ({"phase push": 1}, "phase push: there is no such event")],
)  # fmt: skip
def test_what_cannot_be_is_refused_before_anybody_comes(triggers: dict[str, int], words: str) -> None:
    with pytest.raises(StudyError, match=r"triggers") as refused:
        parsed(PLAIN, triggers=triggers)
    assert words in str(refused.value)
