"""Commands that read run folders: runs, report, export, replay, merge, recover."""
