"""Copy of bytes into shared memory. Compiled, `byte_copy.pyx` takes its place."""


def copy_into(target: memoryview, start: int, payload: bytes) -> None:
    """Copy bytes to `start` and on. Raises ValueError where there is no room for them."""
    if not 0 <= start <= len(target) - len(payload):
        raise ValueError(f"{len(payload)} bytes at {start} do not fit into {len(target)}")
    target[start : start + len(payload)] = payload
