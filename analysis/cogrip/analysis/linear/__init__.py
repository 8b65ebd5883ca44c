"""The linear model of a session over a network frame, and where it is stable and passive."""
