# Quartus project of the firmware for EP4CE115F23I7N (Quartus calls it EP4CE115F23I7), without pins.
#   gyro golden synth --rtl RTL --out DIR      writes gyro_board.v and the two tables
#   cd DIR && quartus_sh -t RTL/quartus/gyro.tcl
# Creates the project in the current folder; `quartus_sh --flow compile gyro` then fits it. Not run by our tests: they
# read this script with another Tcl and look at what it asks for.
package require ::quartus::project

set rtl [file normalize [file join [file dirname [info script]] ..]]

project_new gyro -overwrite
set_global_assignment -name FAMILY "Cyclone IV E"
set_global_assignment -name DEVICE EP4CE115F23I7
set_global_assignment -name TOP_LEVEL_ENTITY gyro_board
set_global_assignment -name VERILOG_INPUT_VERSION SYSTEMVERILOG_2005
set_global_assignment -name PROJECT_OUTPUT_DIRECTORY output
set_global_assignment -name VERILOG_FILE gyro_board.v
foreach source [lsort [glob -directory $rtl *.v]] {
    set_global_assignment -name VERILOG_FILE $source
}
set_global_assignment -name SDC_FILE [file join $rtl quartus gyro.sdc]

# the host's bus and the SAR samples come from logic that is not here: they get no pins
foreach port {write address[*] data[*] sample_x[*] sample_y[*]} {
    set_instance_assignment -name VIRTUAL_PIN ON -to $port
}
# registers at the pins: SYNC, LDAC, CS and SCLK leave from their own flip-flops
foreach port {o_adc_cs_n o_adc_sclk o_drive_sync_n o_sense_sync_n o_sense_ldac_n o_quadrature_sync_n} {
    set_instance_assignment -name FAST_OUTPUT_REGISTER ON -to $port
}
set_global_assignment -name OPTIMIZATION_MODE "HIGH PERFORMANCE EFFORT"
project_close
