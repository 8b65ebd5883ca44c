"""The agreement of both ends of a cogrip session: mathematics, messages, settings.

Everything here is pure (no socket, clock, thread or file) except the `io` sub-package. `SPEC.md` is the normative description.
"""

import cogrip.machine  # noqa: F401 - chooses the form of all modules
