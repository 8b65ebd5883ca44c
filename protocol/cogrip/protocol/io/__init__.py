"""The only sockets, clocks, threads and files of the protocol folder; everything beside it is pure."""
