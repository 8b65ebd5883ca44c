"""`python -m cogrip.cli.serving.worker_process`: a worker, in large pages from its first import on."""

import sys

if __name__ == "__main__":
    from cogrip.machine.platform import system

    system.ignore_end_signals()  # they reach the front, and it ends this process by the link
    from cogrip.machine.large_pages import use_large_pages

    use_large_pages()
    from cogrip.cli.serving.worker import main

    sys.exit(main(sys.argv[1:]))
