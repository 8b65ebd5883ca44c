"""Commands that predict and compare: advise, stability, feel, figures, sweep, compare."""
