"""Sentences about a scene of rigid bodies for those who look at it or hold it: the same in advice, commands and views."""

from collections.abc import Sequence


def left_out_words(words: Sequence[str]) -> str:
    """Return what MuJoCo draws of a scene and viewers do not."""
    return f"not drawn of the scene: {', '.join(words)}, nor are haze, fog and shadows"


def changed_words(words: Sequence[str]) -> str:
    """Return what a scene sets and does not get."""
    sets = ", ".join(words)
    return f"the scene sets {sets}, which does not hold: contact that creates no energy is stepped otherwise"


def unused_words(words: Sequence[str]) -> str:
    """Return what a scene has and nothing uses."""
    return f"what nothing here uses of the scene: {'; '.join(words)}"


def as_sentence(words: str) -> str:
    """Return words as a sentence that stands alone."""
    return f"{words[:1].upper()}{words[1:]}."
