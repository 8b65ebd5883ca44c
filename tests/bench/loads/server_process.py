"""`python -m tests.bench.loads.server_process JOB`: a server under load, in large pages from its first import on."""

from importlib import import_module

from cogrip.protocol.io.large_pages import use_large_pages

use_large_pages()
import_module("tests.bench.loads.server").main()
