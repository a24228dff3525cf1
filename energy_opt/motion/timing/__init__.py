"""How a path is run through in time: the timing law, and TOPP-RA's fastest one."""
