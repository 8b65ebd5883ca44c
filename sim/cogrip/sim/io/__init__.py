"""The socket driver of the relay."""
