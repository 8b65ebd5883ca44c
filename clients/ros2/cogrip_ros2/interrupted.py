"""SIGINT and SIGTERM, of `ros2 run` and `ros2 launch`, as requests to end in order.

Handlers of rclpy's own would shut its publishers down at once: the last message, a force of zero, would never leave.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def on_interrupt(stop: Callable[[], None]) -> Iterator[list[int]]:
    """Call `stop` at each of these signals within the context; gives the list of those that came."""
    came: list[int] = []

    def handle(number: int, frame: object) -> None:
        came.append(number)
        stop()

    before = [(number, signal.signal(number, handle)) for number in (signal.SIGINT, signal.SIGTERM)]
    try:
        yield came
    finally:
        for number, handler in before:
            signal.signal(number, handler)
