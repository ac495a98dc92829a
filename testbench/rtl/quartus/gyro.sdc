# 26 MHz, and what is assumed of the parts and the board; every delay below is an assumption to be replaced.
create_clock -name clk -period 38.461 [get_ports clk]
derive_clock_uncertainty

# ADS1298: DOUT follows a rise of SCLK, which leaves at an edge of clk, and is taken at the next edge:
# 8 ns to the SCLK pin, 17 ns in the part, 1 ns each way on the board; it changes no sooner than 2 ns
set_input_delay -clock clk -max 27.0 [get_ports dout]
set_input_delay -clock clk -min 2.0 [get_ports dout]
# DRDY_N and the reset button are asynchronous: two registers take DRDY_N, the reset is released by hand
set_false_path -from [get_ports {drdy_n rst}]

# DACs: SCLK is clk through an output cell; SDIN and SYNC are taken at its falls, with 5 ns set-up and 10 ns hold
set dac_pins [get_ports {o_drive_sync_n o_drive_sdin o_sense_sync_n o_sense_sdin o_quadrature_sync_n o_quadrature_sdin
                         o_drive_sclk_en o_sense_sclk_en o_quadrature_sclk_en}]
set_output_delay -clock clk -clock_fall -max 5.0 $dac_pins
set_output_delay -clock clk -clock_fall -min -10.0 $dac_pins
# LDAC and the ADC's pins have whole clocks to spare
set_output_delay -clock clk -max 10.0 [get_ports {o_sense_ldac_n o_adc_cs_n o_adc_sclk}]
set_output_delay -clock clk -min 0.0 [get_ports {o_sense_ldac_n o_adc_cs_n o_adc_sclk}]

# references: the four switches must not move against each other; 2 ns are 0.008 degrees at 11 kHz
set_max_delay -to [get_ports {o_refs[*]}] 12.0
set_max_skew -to [get_ports {o_refs[*]}] 2.0
