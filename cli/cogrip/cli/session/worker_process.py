"""`python -m cogrip.cli.session.worker_process`: a worker, in large pages from its first import on."""

import sys
from importlib import import_module

from cogrip.protocol.io.large_pages import use_large_pages

use_large_pages()
sys.exit(import_module("cogrip.cli.session.worker").main(sys.argv[1:]))
