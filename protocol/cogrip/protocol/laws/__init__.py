"""Laws that both ends share: waves, filters, rotations, and the stiffness that a hand feels (docs/theory.md)."""
