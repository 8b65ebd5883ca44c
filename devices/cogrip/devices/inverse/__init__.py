"""Haply Inverse3 and its VerseGrip, over the websocket of Haply's Inverse service."""
