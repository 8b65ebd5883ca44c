"""Drivers of the laboratory's parts: the only sockets and clocks here."""
