"""`python -m cogrip.cli.session.worker_process`: a worker, in large pages from its first import on."""

import sys

from cogrip.protocol.io.large_pages import use_large_pages

if __name__ == "__main__":
    use_large_pages()
    from cogrip.cli.session.worker import main

    sys.exit(main(sys.argv[1:]))
