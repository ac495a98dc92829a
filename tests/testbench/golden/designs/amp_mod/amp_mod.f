-work dsp
dsp/fx.vhd
dsp/mult24x18.vhd
-work my_lib
amp_mod.vhd
