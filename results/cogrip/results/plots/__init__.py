"""The plots of a run: a module a subject, a function a plot, all in `registry.PLOTS`."""
