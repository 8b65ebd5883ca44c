"""Devices that are not there: firmware from the wire's description, an arm's mechanics, a hand behind it, faults as verbs.

Nothing here knows the drivers. In virtual time the family `emulated:` puts a driver and its firmware together; in processes of
their own `cogrip devices emulate` serves the same firmware on a pseudo-terminal.
"""
