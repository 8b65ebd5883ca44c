"""Page behind a university's login: whoever has logged in gets a join link of their own (`docs/login.md`).

A WSGI program. The web server in front does the login (OpenID Connect or SAML) and names the person in REMOTE_USER, and the
groups they are in where GROUPS says. Settings by the environment:

    COGRIP_SIGNER   file of the private key        COGRIP_KID      its name
    COGRIP_SERVER   cogrip://HOST:PORT#FINGERPRINT COGRIP_ROOM     the room
    COGRIP_PLAYERS  group whose people hold the object; everyone else observes
"""

import html
import logging
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from mint_token import mint

GROUPS = "OIDC_CLAIM_groups"  # as Apache's mod_auth_openidc names the claim; mod_shib: "isMemberOf"
SEPARATORS = str.maketrans({",": " ", ";": " "})
Start = Callable[[str, list[tuple[str, str]]], Any]
HEADERS = [
    ("Content-Type", "text/html; charset=utf-8"),
    ("Cache-Control", "no-store"),
    ("Referrer-Policy", "no-referrer"),
]
log = logging.getLogger("login_page")


def application(environ: dict[str, Any], start: Start) -> Iterable[bytes]:
    """Answer one request with a link, good for one time and three hours."""
    person = environ.get("REMOTE_USER", "")
    if not person:  # the web server lets nobody through who has not logged in; so this one is set up wrongly
        start("403 Forbidden", HEADERS)
        return [b"nobody has logged in"]
    groups = environ.get(GROUPS, "").translate(SEPARATORS).split()
    role = "player" if os.environ["COGRIP_PLAYERS"] in groups else "observer"
    key = Path(os.environ["COGRIP_SIGNER"]).read_text(encoding="utf-8")
    link, jti = mint(
        key, os.environ["COGRIP_KID"], os.environ["COGRIP_SERVER"], room=os.environ["COGRIP_ROOM"], role=role, once=True
    )
    log.warning("%r came in as %s by token %s", person, role, jti)  # who it was, for whoever has to revoke it
    start("200 OK", HEADERS)
    return [f"<p>Join as {role}: <code>cogrip join '{html.escape(link)}'</code></p>".encode()]


if __name__ == "__main__":
    from wsgiref.simple_server import make_server

    make_server("127.0.0.1", 8000, application).serve_forever()
