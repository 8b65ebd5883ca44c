"""The computer: clocks, pacing, priority, sockets, memory and processes of each system, and arithmetic that all share."""

from cogrip.machine.compiled_files import choose

choose()
