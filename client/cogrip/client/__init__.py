"""One person's client: the sans-IO core, its safety, and the loop that drives a force-feedback device."""

import cogrip.machine  # noqa: F401 - chooses the form of all modules
