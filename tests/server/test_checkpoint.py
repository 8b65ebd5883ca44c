"""Checkpoints of a room: refused where they are of something else, and without secrets."""

import msgspec
import pytest

from cogrip.protocol.settings.sections import Settings
from cogrip.server.checkpoint import CheckpointError, decode, encode
from cogrip.server.inputs import Restore

from tests.server.test_resumption import Guarded, moved
from tests.server.test_server_core import room


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (room("hall"), "it is of room 'lab'"),
        (room(people=("anna", "carl")), "other settings"),
        (room(object={"axes": 2}), "other settings"),
    ],
)
def test_a_checkpoint_of_something_else_changes_nothing(other: Settings, words: str) -> None:
    before, _ = moved()
    (checkpoint,) = before.core.checkpoint()
    after = Guarded(other)
    with pytest.raises(CheckpointError, match=words):
        after.core.handle(Restore(checkpoint), 0)
    assert not after.core.rooms[0].world.position.any()
    assert not any(seat.ticket_hash for seat in after.core.rooms[0].seats)


@pytest.mark.parametrize("data", [b"", b"{}", b"[1]", b"\xff", b'{"version": 2, "room": "lab"}'])
def test_what_is_no_checkpoint_is_refused(data: bytes) -> None:
    with pytest.raises(CheckpointError):
        decode(data)


def test_a_checkpoint_of_a_later_version_is_refused() -> None:
    before, _ = moved()
    (checkpoint,) = before.core.checkpoint()
    with pytest.raises(CheckpointError, match="version 2, this is 1"):
        decode(encode(msgspec.structs.replace(checkpoint, version=2)))


def test_secrets_are_in_no_checkpoint() -> None:
    before, player = moved()
    data = encode(before.core.checkpoint()[0])
    assert b"hash of" in data
    assert player.ticket.encode() not in data.replace(b"hash of " + player.ticket.encode(), b"")
