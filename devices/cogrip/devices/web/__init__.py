"""The family `web:`: a virtual device that a pointer in a browser moves (`docs/view.md`)."""
