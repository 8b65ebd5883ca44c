"""Parts of the server that touch files, sockets, clocks and processes."""
