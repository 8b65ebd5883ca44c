"""Settings: sections of a file, what each seat gets of them, and what does not fit together."""
