"""Matrix of whole sessions on every network, by people, stiffness and seed, and what each of them must show."""
