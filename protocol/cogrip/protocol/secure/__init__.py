"""The channel under a session, encrypted or not, and the records of DTLS as plain functions."""
