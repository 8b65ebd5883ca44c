"""The only modules of the devices that touch ports, vendor libraries, clocks, threads, processes and files."""
