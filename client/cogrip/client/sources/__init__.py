"""Forces at a hand beside the coupling: their one interface, and what a device itself adds for its user."""
