"""Safety: limits of force, of the motors, of shaking and oscillation, and the energy that a device may get."""
