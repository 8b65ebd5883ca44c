"""Commands for administrators: tokens, who, kick, doctor."""
