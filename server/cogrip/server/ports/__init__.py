"""Ports: the server's end of one line, one class a coupling scheme, within the limits of a seat."""
