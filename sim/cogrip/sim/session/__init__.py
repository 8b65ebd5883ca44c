"""Sessions in virtual time: the laboratory, emulated links, and the relay that applies them to real sockets."""
