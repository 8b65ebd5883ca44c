"""Address of a Ray cluster: whether anybody listens there, before Ray waits a minute for it."""

import socket

PROBE_S = 3.0


class ClusterError(Exception):
    """The cluster cannot be used. The text says why and what to do."""


def probe(address: str) -> None:
    """Raise ClusterError for HOST:PORT where nobody listens."""
    host, colon, port = address.rpartition(":")
    if not (colon and port.isdigit()) or "/" in host:
        return  # "auto", ray://...: Ray's own to resolve
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=PROBE_S).close()
    except OSError as error:
        raise ClusterError(
            f"no Ray cluster at {address}: {error.strerror or error}; start one: ray start --head"
        ) from None
