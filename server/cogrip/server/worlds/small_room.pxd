from cogrip.protocol.addition cimport add_floats
