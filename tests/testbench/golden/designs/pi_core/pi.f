// files of the PI, in order
+incdir+inc
pi_types_pkg.sv
pi_core.sv
