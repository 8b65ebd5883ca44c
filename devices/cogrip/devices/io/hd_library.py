"""The OpenHaptics HD library (libHD) by ctypes: its functions as its headers declare them.

Source: OpenHaptics headers (hdDefines.h, hdDevice.h, hdScheduler.h), for 64 bit, where stdcall has no meaning.
"""

import ctypes
from ctypes import c_char_p, c_double, c_int, c_ubyte, c_uint, c_ulong, c_ushort, c_void_p
from typing import Any, NamedTuple

from cogrip.devices.device import DeviceError
from cogrip.devices.io.platform import HD_LIBRARIES

MOST_ERRORS = 64  # most errors read at once: a library that never stops reporting must not hold up its own servo


class ErrorInfo(ctypes.Structure):
    """HDErrorInfo, which hdGetError returns by value: 12 bytes."""

    _fields_ = (("code", c_uint), ("internal", c_int), ("handle", c_uint))


CALLBACK = ctypes.CFUNCTYPE(c_uint, c_void_p)
_DOUBLES, _INTEGERS = ctypes.POINTER(c_double), ctypes.POINTER(c_int)
_HHD = _ENUM = c_uint

SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "hdInitDevice": (_HHD, [c_char_p]),
    "hdDisableDevice": (None, [_HHD]),
    "hdMakeCurrentDevice": (None, [_HHD]),
    "hdGetCurrentDevice": (_HHD, []),
    "hdBeginFrame": (None, [_HHD]),
    "hdEndFrame": (None, [_HHD]),
    "hdEnable": (None, [_ENUM]),
    "hdDisable": (None, [_ENUM]),
    "hdIsEnabled": (c_ubyte, [_ENUM]),
    "hdGetDoublev": (None, [_ENUM, _DOUBLES]),
    "hdSetDoublev": (None, [_ENUM, _DOUBLES]),
    "hdGetIntegerv": (None, [_ENUM, _INTEGERS]),
    "hdGetString": (c_char_p, [_ENUM]),
    "hdGetErrorString": (c_char_p, [c_uint]),
    "hdGetError": (ErrorInfo, []),
    "hdStartScheduler": (None, []),
    "hdStopScheduler": (None, []),
    "hdScheduleAsynchronous": (c_ulong, [CALLBACK, c_void_p, c_ushort]),
    "hdScheduleSynchronous": (None, [CALLBACK, c_void_p, c_ushort]),
    "hdUnschedule": (None, [c_ulong]),
    "hdWaitForCompletion": (c_ubyte, [c_ulong, c_uint]),
    "hdCheckCalibration": (_ENUM, []),
    "hdUpdateCalibration": (None, [_ENUM]),
}
"""name -> (result, arguments). Handles of callbacks are unsigned long: 64 bit on Linux, 32 on Windows."""


class ErrorReport(NamedTuple):
    """An error of the library, and the handle of the device that was current."""

    code: int
    handle: int
    text: str


def load(library: str) -> ctypes.CDLL:
    """The library at path `library`, "" for the usual names. Raises DeviceError.

    Every call gives up the interpreter's lock: the servo thread may hold the library's lock and wait for the interpreter's.
    """
    names = (library,) if library else HD_LIBRARIES
    why = ""
    for name in names:
        try:
            hd = ctypes.CDLL(name)
        except OSError as error:
            why = why or str(error)
        else:
            _declare(hd, name)
            return hd
    raise DeviceError(
        f"the OpenHaptics HD library cannot be loaded ({why}); install the vendor's driver and OpenHaptics,"
        " or say where it is with library=PATH"
    )


def _declare(hd: ctypes.CDLL, name: str) -> None:
    for function, (result, arguments) in SIGNATURES.items():
        entry = getattr(hd, function, None)
        if entry is None:
            raise DeviceError(f"library {name!r} has no {function}: it is not the OpenHaptics HD library")
        entry.restype, entry.argtypes = result, arguments


def pop_errors(hd: ctypes.CDLL) -> list[ErrorReport]:
    """All errors the library has kept, oldest first; it gives them newest first."""
    reports: list[ErrorReport] = []
    while (error := hd.hdGetError()).code and len(reports) < MOST_ERRORS:
        text = (hd.hdGetErrorString(error.code) or b"").decode(errors="replace")
        reports.insert(0, ErrorReport(error.code, error.handle, text or "no text"))
    return reports
