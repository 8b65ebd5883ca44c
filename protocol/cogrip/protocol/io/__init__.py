"""Sockets, clocks, processes and files of the protocol folder; everything beside it is pure."""
