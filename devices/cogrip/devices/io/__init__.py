"""The only modules of the devices that touch lines, vendor libraries, clocks, threads, processes and files."""
