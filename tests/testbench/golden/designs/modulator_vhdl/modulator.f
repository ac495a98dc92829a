-work dsp
dsp/rounding.vhd
dsp/multiplier.vhd
-work chip
modulator_core.vhd
