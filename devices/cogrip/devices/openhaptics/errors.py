"""Error codes of the HD library, and which of them a session survives.

Source: OpenHaptics headers (hdDefines.h). The toolkit's own hduIsForceError leaves out HD_EXCEEDED_MAX_FORCE_IMPULSE, which is
a force error by its number and meaning.
"""

FORCE_ERRORS = {
    0x200: "warm motors",
    0x201: "exceeded max force",
    0x202: "exceeded max force impulse",
    0x203: "exceeded max velocity",
    0x204: "force error",
}
"""Errors after which the library goes on; the force of the frame is dropped."""

OTHER_ERRORS = {
    0x100: "invalid enum",
    0x101: "invalid value",
    0x102: "invalid operation",
    0x103: "invalid input type",
    0x104: "bad handle",
    0x300: "device fault",
    0x301: "device already initiated",
    0x302: "comm error",
    0x303: "comm config error",
    0x304: "timer error",
    0x400: "illegal begin",
    0x401: "illegal end",
    0x402: "frame error",
    0x500: "invalid priority",
    0x501: "scheduler full",
    0x600: "invalid license",
}

CURES = {
    0x300: "let go of it, check its power, then open it again",
    0x301: "another program, or another device of this session, has it: close that one",
    0x302: "check its cable and power, then open it again",
    0x303: "set it up with the vendor's tool under the name given; on Linux GTDD_HOME must name the folder of its settings",
    0x304: "the computer could not keep its pace: close other programs, then open it again",
    0x600: "install the vendor's licence",
}
OTHER_CURE = "see the vendor's diagnostic program, then open it again"


def name_of(code: int) -> str:
    """Return the name of an error code, for counts."""
    return FORCE_ERRORS.get(code) or OTHER_ERRORS.get(code) or f"error 0x{code:x}"


def cure_for(code: int) -> str:
    """Return the cure for an error that ends a session."""
    return CURES.get(code, OTHER_CURE)
