"""Simulated devices: a plant (the machine), a hand (who holds it), and the shell that makes a `Device` of both."""
