// loop filter
+incdir+inc
fx_pkg.sv
pi_types.sv
gain_stage.sv
loop_filter.sv
