"""Numbers of an array in place, as a C pointer: no count of references is kept of it."""
