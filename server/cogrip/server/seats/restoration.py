"""A room's world put back under the hands of its seats: as a checkpoint has it, or into the middle."""

from collections.abc import Sequence

import numpy as np

from cogrip.machine.rows import Row
from cogrip.server.checkpoint import CheckpointError, RoomCheckpoint
from cogrip.server.seats.participants import Seat
from cogrip.server.worlds.departures import put_back_text
from cogrip.server.worlds.world import World, WorldError, check_saved


def place_again(world: World, seats: Sequence[Seat], checkpoint: RoomCheckpoint) -> None:
    """Put a world back where it was, at rest. Raises CheckpointError, and nothing has changed."""
    users = [seat.name for seat in seats]
    if [seat.user for seat in checkpoint.seats] != users or len(checkpoint.position_m) != world.axes:
        raise CheckpointError("its seats or axes are not this room's")
    try:
        if checkpoint.progress:
            expected, short = len(world.progress.save()), world.progress.unsaved
            check_saved(checkpoint.progress, expected - short * (len(checkpoint.progress) == expected - short))
        world.restore_coordinates(checkpoint.position_m, checkpoint.scene, checkpoint.coordinates)
    except WorldError as error:
        raise CheckpointError(str(error)) from None
    if checkpoint.progress:
        world.progress.restore(checkpoint.progress)


def put_back(world: World, seats: Sequence[Seat], idle_row: Row) -> list[Row]:
    """Put the object at rest in the middle, where everybody takes hold of it anew; return the answers to this step."""
    answers: list[Row] = [()] * len(seats)
    for number, seat in enumerate(seats):
        if seat.on_object:
            world.leave(number)
    world.position = np.zeros(world.axes)
    world.bring_to_rest()
    world.events.append(put_back_text(world.object_name))
    for number, seat in enumerate(seats):
        port = seat.port
        if seat.on_object and port is not None and port.hand is not None:
            world.join(number, np.array(port.hand + idle_row[port.axes : world.axes]))
            answers[number] = port.neutral
    return answers
