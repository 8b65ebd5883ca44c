"""Server of a state folder that answers requests, for commands of administrators."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

from cogrip.server.administration.orders import OrderReply
from cogrip.server.io.control import Control
from cogrip.server.io.state_folder import StateFolder


@contextmanager
def answering(folder: StateFolder, answer: Callable[[Any], dict[str, Any]]) -> Iterator[list[Any]]:
    """Answer the requests to the server of a state folder; give their orders."""
    orders: list[Any] = []
    control, stop = Control(folder), threading.Event()

    def serve() -> None:
        while not stop.wait(0.001):
            for request in control.poll():
                orders.append(request.order)
                control.answer(request, OrderReply(**{"ok": True, **answer(request.order)}))

    with ThreadPoolExecutor(1) as pool:
        loop = pool.submit(serve)
        yield orders
        stop.set()
        loop.result(20.0)
    control.close()
