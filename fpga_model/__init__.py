"""The firmware: integers, one file per block, one step per clock edge."""

COMPILED = True  # read once, by fpga_model.jit
