"""University whose login mints tokens, by the example program of docs/examples/login."""

import secrets
import subprocess
import sys
from pathlib import Path

from cogrip.protocol.wire.join_link import JoinLink

MINT = Path(__file__).parents[2] / "docs" / "examples" / "login" / "mint_token.py"
LIMIT_S = 60.0


class University:
    """A key pair that openssl made, and the example program that mints with it."""

    def __init__(self, folder: Path, kid: str) -> None:
        kid = f"{kid}-{secrets.token_hex(3)}"  # another one where a test is tried again
        self.kid, self.private, self.public = kid, folder / f"{kid}.pem", folder / f"{kid}.public.pem"
        self._openssl("genpkey", "-algorithm", "ed25519", "-out", self.private)
        self._openssl("pkey", "-in", self.private, "-pubout", "-out", self.public)

    @staticmethod
    def _openssl(*words: object) -> None:
        subprocess.run(["openssl", *map(str, words)], check=True, capture_output=True, timeout=LIMIT_S)

    def mint(self, link: JoinLink, *terms: str, code: str = "") -> tuple[str, str]:
        """Return link and jti for the server of a link. code: runs before the program, in its process"""
        server = f"cogrip://{link.host}:{link.port}#{link.fingerprint}"
        begin = (
            ["-c", f"{code}\nimport runpy; runpy.run_path({str(MINT)!r}, run_name='__main__')"] if code else [str(MINT)]
        )
        made = subprocess.run(
            [sys.executable, "-I", *begin, str(self.private), "--kid", self.kid, "--server", server, "--room", link.room,
             *terms],
            capture_output=True, text=True, timeout=LIMIT_S, check=True,
        )  # fmt: skip
        return made.stdout.strip(), made.stderr.split()[1]
