#!/usr/bin/env python3
"""Page behind a university's login: whoever has logged in gets a join link of their own (`docs/login.md`).

A CGI program, so that nobody can reach it past the web server, which does the login (OpenID Connect or SAML) and gives the
person in REMOTE_USER, and their groups where GROUPS says. Settings by the environment:

    COGRIP_SIGNER   file of the private key, which the web server's user alone can read
    COGRIP_KID      name of its key at the server
    COGRIP_SERVER   cogrip://HOST:PORT#FINGERPRINT
    COGRIP_ROOM     the room
    COGRIP_PLAYERS  group whose people hold the object; everyone else observes
"""

import html
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any
from wsgiref.handlers import CGIHandler

from mint_token import mint

GROUPS = "OIDC_CLAIM_groups"  # variable in which Apache's mod_auth_openidc gives the groups; mod_shib's is "isMemberOf"
SEPARATORS = str.maketrans({",": " ", ";": " "})
HEADERS = [
    ("Content-Type", "text/html; charset=utf-8"),
    ("Cache-Control", "no-store"),
    ("Referrer-Policy", "no-referrer"),
]
Start = Callable[[str, list[tuple[str, str]]], Any]


def application(environ: Mapping[str, Any], start: Start) -> Iterable[bytes]:
    """Answer a request with a link: good for one time, and for three hours."""
    person = environ.get("REMOTE_USER", "")
    if not person:  # the web server lets nobody through who has not logged in, so it is set up wrongly
        start("403 Forbidden", HEADERS)
        return [b"nobody has logged in"]
    groups = environ.get(GROUPS, "").translate(SEPARATORS).split()
    role = "player" if environ["COGRIP_PLAYERS"] in groups else "observer"
    key = Path(environ["COGRIP_SIGNER"]).read_text(encoding="utf-8")
    link, jti = mint(
        key, environ["COGRIP_KID"], environ["COGRIP_SERVER"], room=environ["COGRIP_ROOM"], role=role, once=True
    )
    print(f"cogrip: {person!a} gets token {jti} as {role}", file=sys.stderr)  # for whoever has to revoke it
    start("200 OK", HEADERS)
    return [f"<p>Join as {role}: <code>cogrip join '{html.escape(link)}'</code></p>\n".encode()]


if __name__ == "__main__":
    CGIHandler().run(application)
