"""Scheme with models of partners (`coupling.kind = "partner"`, theory 5b): the copy of the object, each model, and the gate."""
