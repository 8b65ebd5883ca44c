"""What both ends of a cogrip session must agree on: mathematics, messages, settings.

Everything here is pure (no socket, clock, thread or file) except the `io` sub-package.
`SPEC.md` beside this package is the normative description of the wire.
"""
