"""Foxglove's protocol over a websocket: moves messages between a connection and `FoxgloveSession`."""

from websockets.asyncio.server import ServerConnection

from cogrip.view.io.page_server import Admitted


async def speak(connection: ServerConnection, admitted: Admitted) -> None:
    """Placeholder."""
