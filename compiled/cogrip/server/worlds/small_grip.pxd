from cogrip.machine.addition cimport add_floats
