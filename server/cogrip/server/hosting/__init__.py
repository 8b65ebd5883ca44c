"""Hosting: where the rooms of a server run, in this process, in several, or on a cluster."""
