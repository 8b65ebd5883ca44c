"""The socket, the clock and the processes of the view."""
