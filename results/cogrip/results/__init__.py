"""Run folders: what a session leaves, read back as columns, judged, reported, exported, merged and replayed."""
