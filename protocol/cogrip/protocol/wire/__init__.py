"""The wire: messages and their parts, the session and its clock (SPEC.md)."""
