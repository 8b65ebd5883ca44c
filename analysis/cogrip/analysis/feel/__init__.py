"""Impedance and stiffness that a hand feels: by the model, and by a probe in virtual time."""
