"""Summary and recordings that a session writes at its end, in a laboratory or brought together from several machines."""
