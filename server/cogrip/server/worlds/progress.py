"""Progress of a run in a world, beside it: measures of the task and of contacts, for checkpoints. No step depends on it."""

from typing import Any

from cogrip.machine.rows import Row


class Progress:
    """That of a world which has no task.

    unsaved  count of numbers at the end of `save` that checkpoints of earlier versions lack
    """

    unsaved = 0

    def account(self) -> dict[str, Any] | None:
        """Return how far the task of the settings has come; None where they state none."""
        return None

    def save(self) -> Row:
        """Return measures of the run so far, of contacts and of the task, for a checkpoint."""
        return ()

    def restore(self, saved: Row) -> None:
        """Continue from measures that `save` returned; called after `World.restore_coordinates`."""
