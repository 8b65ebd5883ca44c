"""The examples of docs/api.md, each run as its reader would, from a folder of its own."""

import json
import os
from pathlib import Path

import pytest

from tests import forked

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "api"
SAID = {
    "stiffness_and_delay": "60 ms",
    "watch_live": "good: True",
    "closed_loop": "good: True",
    "own_device": "good: True",
    "own_hand": "good: True",
    "felt_stiffness": "",
}
LIMIT_S = 120.0


def program(example: Path) -> str:
    """Return the Python of an example; of a notebook that of its cells, in their order."""
    text = example.read_text(encoding="utf-8")
    if example.suffix == ".py":
        return text
    cells = json.loads(text)["cells"]
    return "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")


def test_every_example_is_run_here() -> None:
    assert {path.stem for path in EXAMPLES.iterdir() if path.is_file()} == set(SAID)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", sorted(SAID))
def test_an_example_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (example,) = EXAMPLES.glob(f"{name}.*")
    monkeypatch.chdir(tmp_path)
    with forked.start(code=program(example), env={**os.environ, "MPLBACKEND": "agg"}) as running:
        said, _ = running.communicate(timeout=LIMIT_S)
    assert running.returncode == 0, said
    assert SAID[name] in said
