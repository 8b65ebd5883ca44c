"""The view: a page in the browser that shows a session or a recording, and lets a pointer hold the object (`docs/view.md`)."""
