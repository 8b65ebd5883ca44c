"""Coupling schemes at the client: the law that joins a hand to the object, one class a scheme."""
