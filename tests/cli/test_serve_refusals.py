"""`cogrip serve` as a service: errors that no restart mends end with code 2, dangerous rooms are warned of at the start."""

import configparser
import os
from pathlib import Path

import pytest

from cogrip.server.io.state_folder import make_folder

from tests.cli.spoiled_runs import Cogrip

UNIT = Path(__file__).resolve().parents[2] / "configs" / "cogrip.service"
posix = pytest.mark.skipif(os.name != "posix", reason="a state folder needs Linux or macOS")


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "room.toml"
    path.write_text('name = "lab"\n[[users]]\nname = "anna"\n')
    return path


def served(cogrip: Cogrip, config: Path, *more: object) -> tuple[int, str]:
    runs = config.parent / "runs"
    code, said, problems = cogrip(
        "serve", config, "--port", 0, "--seconds", 0.05, "--no-record", "--no-report", "--runs", runs, *more
    )
    return code, said + problems


@posix
@pytest.mark.parametrize("spoil", ["key", "mode", "certificate", "lost", "tokens"])
def test_a_key_that_cannot_be_used_is_not_tried_again(tmp_path: Path, cogrip: Cogrip, config: Path, spoil: str) -> None:
    state = tmp_path / "state"
    folder = make_folder(state)
    assert served(cogrip, config, "--seal", "--state", state)[0] == 0
    if spoil == "key":
        folder.key.write_bytes(b"nonsense")
    elif spoil == "mode":
        folder.key.chmod(0o644)
    elif spoil == "certificate":
        folder.certificate.write_bytes(b"nonsense")
    elif spoil == "lost":
        folder.certificate.unlink()
    else:
        folder.tokens.write_bytes(b"{}")
    code, said = served(cogrip, config, "--seal", "--state", state)
    assert code == 2, said
    assert str(state) in said.replace("\n", "")
    unit = configparser.ConfigParser(strict=False, interpolation=None, delimiters=("=",))
    unit.read_string(UNIT.read_text().replace("\\\n", " "))
    assert unit["Service"]["RestartPreventExitStatus"] == "2"


@posix
@pytest.mark.parametrize(
    ("coupling", "words"),
    [
        ('server_step = "paper"', 'coupling.server_step = "paper"'),
        ('kind = "coupling"', 'coupling.kind = "coupling"'),
        ('decimator = "none"', 'decimator = "none"'),
    ],
)
def test_a_room_that_is_not_passive_is_warned_of_where_others_can_join(
    tmp_path: Path, cogrip: Cogrip, config: Path, coupling: str, words: str
) -> None:
    config.write_text(f"{config.read_text()}[coupling]\n{coupling}\n")
    warning = f"warning: room lab is not passive ({words}): it can make energy"
    for more in (("--seal", "--state", tmp_path / "state"), ("--host", "0.0.0.0", "--insecure")):
        code, said = served(cogrip, config, *more)
        assert code == 0
        assert warning in said
    assert warning not in served(cogrip, config)[1]  # on this machine alone


@posix
def test_nothing_is_said_of_a_passive_room(tmp_path: Path, cogrip: Cogrip, config: Path) -> None:
    assert "is not passive" not in served(cogrip, config, "--seal", "--state", tmp_path / "state")[1]
