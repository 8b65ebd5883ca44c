"""`python -m tests.bench.loads.server_process JOB`: a server under load, in large pages from its first import on."""

from cogrip.machine.large_pages import use_large_pages

if __name__ == "__main__":
    use_large_pages()
    from tests.bench.loads.server import main

    main()
