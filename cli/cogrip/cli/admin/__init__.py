"""Commands for administrators: token, who, kick, doctor."""
