"""Entry of the `cogrip` command, before anything else of it is imported.

Ctrl-C while modules are imported ends the process at once, with nothing said: an exception that goes through an import leaves
the traceback of code that is nobody's concern, and extension modules make another error of it.
"""

import signal


def main() -> int:
    """Run the command of this process. Return the exit code."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is ignored, as behind `&` in a script
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from cogrip.cli.main import main as run

    return run()
