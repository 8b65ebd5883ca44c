"""The laboratory: whole sessions in virtual time, link emulation, recorded delays."""
