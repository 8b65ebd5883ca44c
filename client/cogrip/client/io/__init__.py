"""The client's sockets."""
