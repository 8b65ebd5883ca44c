"""Sessions in virtual time: the laboratory, emulated links, and the relay that applies these to real sockets."""
