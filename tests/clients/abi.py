"""The binary interface of the client in C, as cogrip.h has it: functions, places of fields, numbers of names."""

import ctypes
import re
from typing import Any

from tests.clients.compiled import HEADER, structure

STRUCTS = ("cogrip_config", "cogrip_link_count", "cogrip_status", "cogrip_target")
MEMORY = ("COGRIP_AXES", "COGRIP_MESSAGE_BYTES", "COGRIP_TEXT_BYTES", "COGRIP_CLIENT_BYTES", "COGRIP_DRIVER_BYTES")
ENUM = re.compile(r"enum(?: \w+)? \{(.*?)\}", re.DOTALL)
FUNCTION = re.compile(r"COGRIP_API ([\w ]+?\*?)\s*(cogrip_\w+)\((.*?)\);", re.DOTALL)


def interface() -> dict[str, Any]:
    """Return what a program that was compiled with the header relies on, for the layouts of 64-bit Linux."""
    return {
        "functions": {
            name: f"{result}({' '.join(arguments.split())})" for result, name, arguments in FUNCTION.findall(HEADER)
        },
        "structs": {name: fields_of(structure(name)) for name in STRUCTS},
        "enums": {
            name: number
            for body in ENUM.findall(HEADER)
            for number, name in enumerate(re.findall(r"COGRIP_\w+", body))
            if name != "COGRIP_COUNTS"
        },
        "memory": {name: re.search(rf"#define {name} +(.+)", HEADER)[1].strip() for name in MEMORY},  # type: ignore[index]
    }


def fields_of(kind: Any) -> dict[str, int]:
    """Return the place of each field [bytes], in their order; of the whole under ""."""
    return {**{name: getattr(kind, name).offset for name, *_ in kind._fields_}, "": ctypes.sizeof(kind)}
