half_adder48.v
nco.v
