"""`cogrip serve` as a service: errors that no restart mends end with code 2, dangerous rooms are warned of at the start."""

import configparser
import os
import re
import shutil
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from cogrip.cli.main import main
from cogrip.server.io.state_folder import StateFolder, make_folder, one_server

from tests.cli.command import Cogrip
from tests.free_ports import free_port

UNIT = Path(__file__).resolve().parents[2] / "configs" / "cogrip.service"
ROOM = 'name = "lab"\n[[users]]\nname = "anna"\n'
MOMENT = ("--seconds", "0.05", "--no-record", "--no-report")
posix = pytest.mark.skipif(os.name != "posix", reason="a state folder needs Linux or macOS")


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "room.toml"
    path.write_text(ROOM)
    return path


@pytest.fixture
def serve(cogrip: Cogrip, config: Path) -> Cogrip:
    """Serve the room for a moment."""
    return cogrip.within("serve", config, "--runs", config.parent / "runs", "--port", 0, *MOMENT)


@pytest.fixture(scope="module")
def used(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a state folder with a server's key, certificate and tokens."""
    state = tmp_path_factory.mktemp("used") / "state"
    room = state.with_name("room.toml")
    room.write_text(ROOM)
    assert main(["serve", str(room), "--port", "0", *MOMENT, "--encrypted", "--state", str(state)]) == 0
    return state


@posix
@pytest.mark.parametrize(
    "spoil",
    [
        lambda folder: folder.key.write_bytes(b"nonsense"),
        lambda folder: folder.key.chmod(0o644),
        lambda folder: folder.certificate.write_bytes(b"nonsense"),
        lambda folder: folder.certificate.unlink(),
        lambda folder: folder.tokens.write_bytes(b"{}"),
    ],
    ids=["key", "mode", "certificate", "lost", "tokens"],
)
def test_a_key_that_cannot_be_used_is_not_tried_again(
    tmp_path: Path, used: Path, serve: Cogrip, spoil: Callable[[StateFolder], object]
) -> None:
    state = Path(shutil.copytree(used, tmp_path / "state"))
    spoil(make_folder(state))
    assert str(state) in serve.err("--encrypted", "--state", state).replace("\n", "")
    unit = configparser.ConfigParser(strict=False, interpolation=None, delimiters=("=",))
    unit.read_string(UNIT.read_text().replace("\\\n", " "))
    assert unit["Service"]["RestartPreventExitStatus"] == "2"


@pytest.mark.sample(1)
@posix
@pytest.mark.parametrize("coupling", ['server_step = "paper"', 'kind = "coupling"', 'decimator = "none"'])
def test_a_room_that_is_not_passive_is_warned_of_where_others_can_join(
    tmp_path: Path, serve: Cogrip, config: Path, coupling: str
) -> None:
    config.write_text(f"{config.read_text()}[coupling]\n{coupling}\n")
    warning = re.compile(rf"warning: room lab is not passive \((coupling\.)?{coupling}\): it can make energy")
    assert warning.search(serve.out("--host", "0.0.0.0", "--insecure"))
    if "paper" in coupling:
        assert warning.search(serve.out("--encrypted", "--state", tmp_path / "state"))
        assert not warning.search(serve.out("--insecure"))  # on this machine alone


@posix
def test_a_port_that_another_server_has_is_one_line(
    tmp_path: Path, config: Path, cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It holds the state folder of its port as well, of which nothing is said then."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    port = free_port()
    serve = cogrip.within("serve", config, "--runs", tmp_path / "runs", "--port", port, *MOMENT)
    with one_server(make_folder(tmp_path / "state" / "cogrip" / str(port))):
        assert "warning: nothing can be restored" in serve.out(), "where the port is free it is worth a line"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.1", port))
            out, err = serve.texts(code=1)
    words = f"cogrip: cannot listen on 127.0.0.1:{port}: Address already in use; choose another --port, or"
    assert (out, err.count("\n"), err.startswith(words)) == ("", 1, True), err


@posix
@pytest.mark.parametrize("flag", ["--encrypted", "--seal"])  # the earlier name
def test_loopback_is_encrypted_on_request(tmp_path: Path, serve: Cogrip, flag: str) -> None:
    out = serve.out(flag, "--state", tmp_path / "state")
    assert ", encrypted; rooms: lab" in out
    assert "is not passive" not in out, "nothing is said of a passive room"
    assert "--encrypted and --insecure exclude each other" in serve.err(flag, "--insecure")
