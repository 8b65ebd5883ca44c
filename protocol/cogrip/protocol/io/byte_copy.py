"""Copy of bytes into shared memory. Compiled, `byte_copy.pyx` takes its place."""


def copy_into(target: memoryview, start: int, payload: bytes) -> None:
    """Copy bytes to `start` and on. There must be room for them."""
    target[start : start + len(payload)] = payload
