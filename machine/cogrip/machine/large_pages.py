"""Large pages for the memory of a process. Compiled, `large_pages.pyx` takes its place (Linux)."""


def large_pages_permission() -> str:
    """Return "yes" where processes can have large pages, else "no, " and why."""
    from cogrip.machine.compiled_files import compile_command  # this module is the first one of a process

    return f"no, only in the compiled form on Linux (`{compile_command()}`)"


def use_large_pages() -> None:
    """Ask for pages of 2 MB for what this process allocates from now on."""


def uses_large_pages() -> bool:
    """Return whether this process has asked for them: what its heap gives back then, it gets again in small ones."""
    return False
