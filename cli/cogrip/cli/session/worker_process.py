"""`python -m cogrip.cli.session.worker_process`: a worker, in large pages from its first import on."""

import signal
import sys

if __name__ == "__main__":  # before anything else is imported: these signals reach the front, which ends this process
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)

    from cogrip.protocol.io.large_pages import use_large_pages

    use_large_pages()
    from cogrip.cli.session.worker import main

    sys.exit(main(sys.argv[1:]))
