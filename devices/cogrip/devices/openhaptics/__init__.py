"""Touch, Phantom Omni, Desktop and Premium through the OpenHaptics HD library, which calls us a thousand times a second."""
