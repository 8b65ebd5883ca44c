"""Commands on run folders: runs, report, export, replay, merge, recover."""
