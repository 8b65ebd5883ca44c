"""The laboratory: whole sessions in virtual time, link emulation, run folders and reports."""
