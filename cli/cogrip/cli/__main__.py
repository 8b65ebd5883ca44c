"""`python -m cogrip.cli`."""

import sys

if not sys.flags.safe_path:
    del sys.path[0]  # the current folder: nothing in it is to run as part of this program

from cogrip.cli.start import main

sys.exit(main())
