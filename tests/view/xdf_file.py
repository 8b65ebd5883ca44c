"""XDF files of one stream, as LabRecorder writes them (the XDF 1.0 specification)."""

import struct
from collections.abc import Sequence
from pathlib import Path

FILE_HEADER, STREAM_HEADER, SAMPLES, STREAM_FOOTER = 1, 2, 3, 6
STREAM = struct.pack("<I", 1)


def _chunk(tag: int, content: bytes) -> bytes:
    body = struct.pack("<H", tag) + content
    return b"\x04" + struct.pack("<I", len(body)) + body


def write_xdf(path: Path, header_xml: str, times_s: Sequence[float], rows: Sequence[Sequence[float]]) -> None:
    """Write a stream of doubles. header_xml: its `StreamInfo` as XML."""
    samples = b"\x04" + struct.pack("<I", len(times_s))
    for at_s, row in zip(times_s, rows, strict=True):
        samples += b"\x08" + struct.pack("<d", at_s) + struct.pack(f"<{len(row)}d", *row)
    footer = f"<?xml version='1.0'?><info><first_timestamp>{times_s[0]}</first_timestamp></info>"
    path.write_bytes(
        b"XDF:"
        + _chunk(FILE_HEADER, b"<?xml version='1.0'?><info><version>1.0</version></info>")
        + _chunk(STREAM_HEADER, STREAM + header_xml.encode())
        + _chunk(SAMPLES, STREAM + samples)
        + _chunk(STREAM_FOOTER, STREAM + footer.encode())
    )
