"""Admission to a server's rooms: who may come in, on which seat, and who is there.

`joining` answers a hello. It asks the authenticator of `admission` whether it may come in, which goes by `tokens`, or
by `signed_tokens` and `token_keys` where others minted the token, and `seat_assignment` for a place; `roster` lists who has
one.
"""
