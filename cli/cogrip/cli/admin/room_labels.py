"""Labels of a room on demand, as commands take them."""

from collections.abc import Sequence

from cogrip.cli.admin.state_folder import check_words
from cogrip.cli.terminal.problem import BadInput
from cogrip.server.administration.orders import MOST_WORD


def labels_of(texts: Sequence[str], command: str) -> dict[str, str]:
    """Return labels of KEY=VALUE texts. Raises BadInput."""
    found: dict[str, str] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not (key and equals and value):
            raise BadInput(f"{command}: --label {text!r}: write KEY=VALUE")
        check_words(f"{command}: --label", max(key, value, key=len), MOST_WORD)
        found[key] = value
    return found
