"""`dev.py windows`: run the client side by Windows' own Python under Wine; nothing to do where that cannot be."""

import sys

from tests.wine.checks import CHECKS, Wine, run_checks
from tests.wine.environment import ROOT, build, missing

FOLDER = ROOT / ".wine"


def main(argv: list[str]) -> int:
    """Return the exit code: 0 where all that was tried is well, or nothing could be tried."""
    keep = "--keep" in argv
    wanted = frozenset(argv) - {"--keep"}
    if unknown := wanted - {*CHECKS}:
        print(f"dev.py windows: no check {min(unknown)!r}; there is: {', '.join(CHECKS)}, and --keep", file=sys.stderr)
        return 2
    if why := missing():
        print(f"dev.py windows: skipped: {'; '.join(why)} (Debian: apt install wine gcc-mingw-w64-x86-64)")
        return 0
    python = FOLDER / "windows" / "python.exe"
    if not (keep and python.exists()):
        print("dev.py windows: making Windows' Python with cogrip and its packages, a minute", flush=True)
        build(FOLDER / "windows")
    failed = run_checks(Wine(python, FOLDER / "work", FOLDER / "prefix"), lambda text: print(text, flush=True), wanted)
    print(f"dev.py windows: {len(wanted or CHECKS) - failed} of {len(wanted or CHECKS)} are well")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
