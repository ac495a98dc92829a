`define PI_FRAC 24
