"""What of the server touches files, sockets, clocks and processes."""
