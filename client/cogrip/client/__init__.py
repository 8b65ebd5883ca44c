"""One person's client: the sans-IO core, its safety, and the loop that drives a force-feedback device."""
