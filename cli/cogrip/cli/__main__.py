"""`python -m cogrip.cli`."""

import sys

from cogrip.cli.main import main

sys.exit(main())
