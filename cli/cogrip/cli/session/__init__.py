"""Commands that run or show a session here: demo, lab, join, view, and settings that ship."""
