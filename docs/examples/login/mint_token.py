"""Mint a signed token and print its join link, where cogrip is not installed: `pip install 'pyjwt[crypto]'`.

    python mint_token.py signer.pem --kid uni-2026 --server 'cogrip://lab.example:47800#FINGERPRINT' --room lab --seat anna

`signer.pem` is an Ed25519 private key (`openssl genpkey -algorithm ed25519 -out signer.pem`), or a file with one line of a
shared secret (`openssl rand -hex 32`). The server gets the public key, or that secret, by `cogrip token keys add`.
"""

import argparse
import sys
import time
import uuid
from pathlib import Path
from urllib.parse import quote

import jwt

MOST_CHARACTERS = 640  # longest token that a client can show a server
MOST_SECONDS = 86_400  # longest life of a token that a server takes


def mint(
    key: str,
    kid: str,
    server: str,
    *,
    room: str,
    role: str = "player",
    seat: str = "",
    device: str = "",
    force_n: float = 0.0,
    speed_mps: float = 0.0,
    once: bool = False,
    seconds: int = 10_800,
    sub: str = "",
    now_s: float | None = None,
) -> tuple[str, str]:
    """Return the join link, and the id (jti) by which `cogrip token revoke` ends it.

    key     text of the private key, or the secret
    server  cogrip://HOST:PORT#FINGERPRINT
    device  beginning of the addresses of devices that may be used, such as haply: ; "" any
    force_n, speed_mps  most force [N] and speed [m/s] that the device may have; 0 what the room allows
    seconds life of the token: as long as the session, as one that has expired resumes nothing
    sub     whatever the login knows the person by: the server does not look at it
    """
    place, _, fingerprint = server.partition("#")
    now = int(time.time() if now_s is None else now_s)
    claims = {"aud": fingerprint, "iat": now, "exp": now + seconds, "jti": uuid.uuid4().hex, "room": room, "role": role}
    more = {"seat": seat, "device": device, "force_n": force_n, "speed_mps": speed_mps, "once": once, "sub": sub}
    claims |= {name: value for name, value in more.items() if value}
    algorithm = "EdDSA" if "PRIVATE KEY" in key else "HS256"
    token = jwt.encode(claims, key.strip(), algorithm, headers={"kid": kid})
    if not 0 < seconds <= MOST_SECONDS:
        raise ValueError(f"{seconds} s are no life of a token: 1 to {MOST_SECONDS}")
    if len(token) > MOST_CHARACTERS:
        raise ValueError(
            f"the token has {len(token)} characters, more than {MOST_CHARACTERS}: shorten sub, device or kid"
        )
    return f"{place.rstrip('/')}/{quote(room, safe='')}#{fingerprint}.{token}", claims["jti"]


def main() -> int:
    """Print the link; on standard error its id."""
    parser = argparse.ArgumentParser(description="Mint a signed token of cogrip.")
    parser.add_argument("key", type=Path)
    parser.add_argument("--kid", required=True)
    parser.add_argument("--server", required=True)
    parser.add_argument("--room", required=True)
    parser.add_argument("--role", default="player", choices=("player", "observer"))
    parser.add_argument("--seat", default="")
    parser.add_argument("--device", default="")
    parser.add_argument("--force-n", type=float, default=0.0)
    parser.add_argument("--speed-mps", type=float, default=0.0)
    parser.add_argument("--once", action="store_true")
    parser.add_argument("--seconds", type=int, default=10_800)
    parser.add_argument("--sub", default="")
    asked = vars(parser.parse_args())
    key, kid, server = asked.pop("key").read_text(), asked.pop("kid"), asked.pop("server")
    try:
        link, jti = mint(key, kid, server, **asked)
    except ValueError as error:
        print(f"mint_token.py: {error}", file=sys.stderr)
        return 2
    print(f"jti {jti}", file=sys.stderr)
    print(link)
    return 0


if __name__ == "__main__":
    sys.exit(main())
