// The whole firmware: wiring only. Every block reads the registers that its neighbours held before the edge.
//   dds, two sines, delays, modulators and DAC masters; references; ADC master or digital SID to control to words;
//   rates, watchdog and register bank. digital = 1: codes from the demodulator in here, else from the ADC
// V_q is sent every 1, 2, 4 .. ticks, at most at 500 kHz; with quadrature_fast = 1 at 1 MHz.
// Registers are ports of the contract r_<name>.
// Parameters and ports have the flattened names of the model's; SINE_ROM_FILE, CORDIC_ROM_FILE are the two tables.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_top #(
    parameter        [31:0] MASTER_HZ                           = 32'd26000000,
    parameter               TICK_CLOCKS                         = 26,
    parameter               FRAME_TICKS                         = 125,
    parameter               DDS_BITS                            = 48,
    parameter               SINE_ADDRESS_BITS                   = 10,
    parameter               SINE_FRACTION_BITS                  = 10,
    parameter               SINE_BITS                           = 18,
    parameter               CORDIC_ITERATIONS                   = 24,
    parameter               CORDIC_GUARD_BITS                   = 8,
    parameter               ACCUMULATOR_FRACTION_BITS           = 24,
    parameter               ADC_DIVIDER                         = 2,
    parameter               ADC_WORD_BITS                       = 24,
    parameter               ADC_CHANNELS                        = 8,
    parameter               ADC_TAIL_CLOCKS                     = 54,
    parameter         [0:0] digital                             = 1'd0,
    parameter         [0:0] quadrature_fast                     = 1'd0,
    parameter         [3:0] pipe_depth                          = 4'd0,    // [0,4,0]
    parameter         [1:0] references_align                    = 2'd0,    // [0,2,0]
    parameter         [0:0] references_retimed                  = 1'd0,
    parameter         [5:0] drive_modulator_shift               = 6'd0,    // [0,6,0]
    parameter signed [19:0] drive_modulator_lo                  = 20'sd0,  // [1,19,0]
    parameter signed [19:0] drive_modulator_hi                  = 20'sd0,  // [1,19,0]
    parameter         [1:0] drive_modulator_frames              = 2'd0,    // [0,2,0]
    parameter         [5:0] sense_modulator_shift               = 6'd0,    // [0,6,0]
    parameter signed [19:0] sense_modulator_lo                  = 20'sd0,  // [1,19,0]
    parameter signed [19:0] sense_modulator_hi                  = 20'sd0,  // [1,19,0]
    parameter         [1:0] sense_modulator_frames              = 2'd0,    // [0,2,0]
    parameter         [4:0] drive_dac_bits                      = 5'd0,    // [0,5,0]
    parameter         [1:0] drive_dac_lead                      = 2'd0,    // [0,2,0]
    parameter         [0:0] drive_dac_ldac                      = 1'd0,
    parameter        [19:0] drive_dac_flip                      = 20'd0,   // [0,20,0]
    parameter        [23:0] drive_dac_header                    = 24'd0,   // [0,24,0]
    parameter        [23:0] drive_dac_control                   = 24'd0,   // [0,24,0]
    parameter        [19:0] drive_dac_data_mask                 = 20'd0,   // [0,20,0]
    parameter         [3:0] drive_dac_tail                      = 4'd0,    // [0,4,0]
    parameter         [1:0] drive_dac_gap                       = 2'd0,    // [0,2,0]
    parameter         [0:0] drive_dac_strobe                    = 1'd0,
    parameter         [4:0] sense_dac_bits                      = 5'd0,    // [0,5,0]
    parameter         [1:0] sense_dac_lead                      = 2'd0,    // [0,2,0]
    parameter         [0:0] sense_dac_ldac                      = 1'd0,
    parameter        [19:0] sense_dac_flip                      = 20'd0,   // [0,20,0]
    parameter        [23:0] sense_dac_header                    = 24'd0,   // [0,24,0]
    parameter        [23:0] sense_dac_control                   = 24'd0,   // [0,24,0]
    parameter        [19:0] sense_dac_data_mask                 = 20'd0,   // [0,20,0]
    parameter         [3:0] sense_dac_tail                      = 4'd0,    // [0,4,0]
    parameter         [1:0] sense_dac_gap                       = 2'd0,    // [0,2,0]
    parameter         [0:0] sense_dac_strobe                    = 1'd0,
    parameter         [4:0] quadrature_dac_bits                 = 5'd0,    // [0,5,0]
    parameter         [1:0] quadrature_dac_lead                 = 2'd0,    // [0,2,0]
    parameter         [0:0] quadrature_dac_ldac                 = 1'd0,
    parameter        [19:0] quadrature_dac_flip                 = 20'd0,   // [0,20,0]
    parameter        [23:0] quadrature_dac_header               = 24'd0,   // [0,24,0]
    parameter        [23:0] quadrature_dac_control              = 24'd0,   // [0,24,0]
    parameter        [19:0] quadrature_dac_data_mask            = 20'd0,   // [0,20,0]
    parameter         [3:0] quadrature_dac_tail                 = 4'd0,    // [0,4,0]
    parameter         [1:0] quadrature_dac_gap                  = 2'd0,    // [0,2,0]
    parameter         [0:0] quadrature_dac_strobe               = 1'd0,
    parameter        [19:0] sid_alpha                           = 20'd0,   // [0,0,20]
    parameter        [20:0] sid_gain_x                          = 21'd0,   // [0,4,17]
    parameter        [20:0] sid_gain_y                          = 21'd0,   // [0,4,17]
    parameter         [2:0] sid_ref_delay                       = 3'd0,    // [0,3,0]
    parameter        [11:0] sid_still                           = 12'd0,   // [0,12,0]
    parameter         [9:0] watchdog_limit                      = 10'd0,   // [0,10,0]
    parameter signed [33:0] control_agc_loop_kp                 = 34'sd0,  // [1,9,24]
    parameter signed [33:0] control_agc_loop_ki                 = 34'sd0,  // [1,9,24]
    parameter signed [35:0] control_agc_loop_lo                 = 36'sd0,  // [1,35,0]
    parameter signed [35:0] control_agc_loop_hi                 = 36'sd0,  // [1,35,0]
    parameter signed [23:0] control_agc_kick                    = 24'sd0,  // [1,0,23]
    parameter signed [33:0] control_frequency_tracker_loop_kp   = 34'sd0,  // [1,9,24]
    parameter signed [33:0] control_frequency_tracker_loop_ki   = 34'sd0,  // [1,9,24]
    parameter signed [35:0] control_frequency_tracker_loop_lo   = 36'sd0,  // [1,35,0]
    parameter signed [35:0] control_frequency_tracker_loop_hi   = 36'sd0,  // [1,35,0]
    parameter signed [33:0] control_rate_loop_loop_kp           = 34'sd0,  // [1,9,24]
    parameter signed [33:0] control_rate_loop_loop_ki           = 34'sd0,  // [1,9,24]
    parameter signed [35:0] control_rate_loop_loop_lo           = 36'sd0,  // [1,35,0]
    parameter signed [35:0] control_rate_loop_loop_hi           = 36'sd0,  // [1,35,0]
    parameter signed [33:0] control_quadrature_loop_loop_kp     = 34'sd0,  // [1,9,24]
    parameter signed [33:0] control_quadrature_loop_loop_ki     = 34'sd0,  // [1,9,24]
    parameter signed [35:0] control_quadrature_loop_loop_lo     = 36'sd0,  // [1,35,0]
    parameter signed [35:0] control_quadrature_loop_loop_hi     = 36'sd0,  // [1,35,0]
    parameter        [15:0] control_sequencer_power_up          = 16'd0,   // [0,16,0]
    parameter        [15:0] control_sequencer_init              = 16'd0,   // [0,16,0]
    parameter        [15:0] control_sequencer_kick              = 16'd0,   // [0,16,0]
    parameter        [15:0] control_sequencer_decay             = 16'd0,   // [0,16,0]
    parameter        [15:0] control_sequencer_search            = 16'd0,   // [0,16,0]
    parameter        [15:0] control_sequencer_retune            = 16'd0,   // [0,16,0]
    parameter        [15:0] control_sequencer_timeout           = 16'd0,   // [0,16,0]
    parameter        [15:0] control_sequencer_offline           = 16'd0,   // [0,16,0]
    parameter        [15:0] control_sequencer_recover           = 16'd0,   // [0,16,0]
    parameter        [16:0] control_sequencer_reached           = 17'd0,   // [0,17,0]
    parameter        [24:0] control_sequencer_min_magnitude     = 25'd0,   // [0,25,0]
    parameter        [23:0] control_sequencer_gain              = 24'd0,   // [0,8,16]
    parameter signed [DDS_BITS-1:0] control_sequencer_search_limit = 0,       // [1,-1,48]
    parameter        [23:0] control_sequencer_lock_limit_in_0   = 24'd0,   // [0,24,0]
    parameter        [23:0] control_sequencer_lock_limit_in_1   = 24'd0,   // [0,24,0]
    parameter        [23:0] control_sequencer_lock_limit_in_2   = 24'd0,   // [0,24,0]
    parameter        [23:0] control_sequencer_lock_limit_in_3   = 24'd0,   // [0,24,0]
    parameter        [23:0] control_sequencer_lock_limit_out_0  = 24'd0,   // [0,24,0]
    parameter        [23:0] control_sequencer_lock_limit_out_1  = 24'd0,   // [0,24,0]
    parameter        [23:0] control_sequencer_lock_limit_out_2  = 24'd0,   // [0,24,0]
    parameter        [23:0] control_sequencer_lock_limit_out_3  = 24'd0,   // [0,24,0]
    parameter        [11:0] control_sequencer_lock_frames_in_0  = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_lock_frames_in_1  = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_lock_frames_in_2  = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_lock_frames_in_3  = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_lock_frames_out_0 = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_lock_frames_out_1 = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_lock_frames_out_2 = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_lock_frames_out_3 = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_faults_over_range = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_faults_stuck      = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_faults_drive      = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_faults_rate       = 12'd0,   // [0,12,0]
    parameter        [11:0] control_sequencer_faults_rail       = 12'd0,   // [0,12,0]
    parameter        [15:0] control_sequencer_faults_top        = 16'hFFFF, // [0,16,0]
    parameter               SINE_ROM_FILE                       = "",
    parameter               CORDIC_ROM_FILE                     = ""
) (
    input  wire               clk,
    input  wire               rst,                                       // synchronous, active high
    input  wire               drdy_n,                                    // pins of the ADC
    input  wire               dout,
    input  wire signed [17:0] sample_x,                                  // [1,17,0]
    input  wire signed [17:0] sample_y,                                  // [1,17,0]
    input  wire               write,                                     // bus of the host: one write a clock
    input  wire         [7:0] address,                                   // [0,8,0]
    input  wire        [47:0] data,                                      // [0,48,0]
    output wire        [$clog2(TICK_CLOCKS)-1:0] r_rates_tick,           // [0,5,0]
    output wire        [$clog2(FRAME_TICKS)-1:0] r_rates_frame,          // [0,7,0]
    output wire         [5:0] r_rates_slot,                              // [0,6,0]
    output wire        [DDS_BITS-1:0] r_dds_phase,                       // [0,0,48]
    output wire        [DDS_BITS-1:0] r_dds_drive_sine,                  // [0,0,48]
    output wire        [DDS_BITS-1:0] r_dds_sense_sine,                  // [0,0,48]
    output wire        [DDS_BITS-1:0] r_dds_drive_ref,                   // [0,0,48]
    output wire        [DDS_BITS-1:0] r_dds_sense_ref,                   // [0,0,48]
    output wire               r_drive_sine_sign,
    output wire        [SINE_BITS+4:0] r_drive_sine_base,                // [0,17,6]
    output wire        [SINE_BITS-SINE_ADDRESS_BITS+4:0] r_drive_sine_slope, // [0,8,5]
    output wire        [SINE_FRACTION_BITS-1:0] r_drive_sine_fraction,   // [0,0,10]
    output wire               r_drive_sine_sign2,
    output wire        [SINE_BITS+4:0] r_drive_sine_base2,               // [0,17,6]
    output wire        [SINE_BITS-SINE_ADDRESS_BITS+SINE_FRACTION_BITS+5:0] r_drive_sine_product, // [0,8,16]
    output wire signed [SINE_BITS-1:0] r_drive_sine_y,                   // [1,0,17]
    output wire               r_sense_sine_sign,
    output wire        [SINE_BITS+4:0] r_sense_sine_base,                // [0,17,6]
    output wire        [SINE_BITS-SINE_ADDRESS_BITS+4:0] r_sense_sine_slope, // [0,8,5]
    output wire        [SINE_FRACTION_BITS-1:0] r_sense_sine_fraction,   // [0,0,10]
    output wire               r_sense_sine_sign2,
    output wire        [SINE_BITS+4:0] r_sense_sine_base2,               // [0,17,6]
    output wire        [SINE_BITS-SINE_ADDRESS_BITS+SINE_FRACTION_BITS+5:0] r_sense_sine_product, // [0,8,16]
    output wire signed [SINE_BITS-1:0] r_sense_sine_y,                   // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_drive_pipe_taps_0,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_drive_pipe_taps_1,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_drive_pipe_taps_2,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_drive_pipe_taps_3,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_drive_pipe_taps_4,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_drive_pipe_taps_5,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_drive_pipe_taps_6,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_drive_pipe_taps_7,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_sense_pipe_taps_0,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_sense_pipe_taps_1,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_sense_pipe_taps_2,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_sense_pipe_taps_3,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_sense_pipe_taps_4,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_sense_pipe_taps_5,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_sense_pipe_taps_6,              // [1,0,17]
    output wire signed [SINE_BITS-1:0] r_sense_pipe_taps_7,              // [1,0,17]
    output wire         [3:0] r_references_signs,                        // [0,4,0]
    output wire         [3:0] r_references_aligned_0,                    // [0,4,0]
    output wire         [3:0] r_references_aligned_1,                    // [0,4,0]
    output wire         [3:0] r_references_aligned_2,                    // [0,4,0]
    output wire         [3:0] r_references_retimed,                      // [0,4,0]
    output wire signed [SINE_BITS+23:0] r_drive_modulator_product,       // [1,1,40]
    output wire signed [19:0] r_drive_modulator_code,                    // [1,19,0]
    output wire signed [19:0] r_drive_modulator_held1,                   // [1,19,0]
    output wire signed [19:0] r_drive_modulator_held2,                   // [1,19,0]
    output wire signed [SINE_BITS+23:0] r_sense_modulator_product,       // [1,1,40]
    output wire signed [19:0] r_sense_modulator_code,                    // [1,19,0]
    output wire signed [19:0] r_sense_modulator_held1,                   // [1,19,0]
    output wire signed [19:0] r_sense_modulator_held2,                   // [1,19,0]
    output wire        [23:0] r_drive_dac_shift,                         // [0,24,0]
    output wire         [4:0] r_drive_dac_left,                          // [0,5,0]
    output wire         [1:0] r_drive_dac_lead,                          // [0,2,0]
    output wire               r_drive_dac_sync_n,
    output wire               r_drive_dac_sclk_en,
    output wire               r_drive_dac_ldac_n,
    output wire               r_drive_dac_ldac_wait,
    output wire        [23:0] r_sense_dac_shift,                         // [0,24,0]
    output wire         [4:0] r_sense_dac_left,                          // [0,5,0]
    output wire         [1:0] r_sense_dac_lead,                          // [0,2,0]
    output wire               r_sense_dac_sync_n,
    output wire               r_sense_dac_sclk_en,
    output wire               r_sense_dac_ldac_n,
    output wire               r_sense_dac_ldac_wait,
    output wire        [23:0] r_quadrature_dac_shift,                    // [0,24,0]
    output wire         [4:0] r_quadrature_dac_left,                     // [0,5,0]
    output wire         [1:0] r_quadrature_dac_lead,                     // [0,2,0]
    output wire               r_quadrature_dac_sync_n,
    output wire               r_quadrature_dac_sclk_en,
    output wire               r_quadrature_dac_ldac_n,
    output wire               r_quadrature_dac_ldac_wait,
    output wire               r_adc_meta,
    output wire               r_adc_sync,
    output wire               r_adc_seen,
    output wire               r_adc_busy,
    output wire        [$clog2(ADC_DIVIDER/2*ADC_WORD_BITS|ADC_TAIL_CLOCKS)-1:0] r_adc_count, // [0,6,0]
    output wire               r_adc_cs_n,
    output wire               r_adc_sclk,
    output wire        [23:0] r_adc_shift,                               // [0,24,0]
    output wire         [3:0] r_adc_word,                                // [0,4,0]
    output wire        [23:0] r_adc_status,                              // [0,24,0]
    output wire signed [23:0] r_adc_channels_0,                          // [1,23,0]
    output wire signed [23:0] r_adc_channels_1,                          // [1,23,0]
    output wire signed [23:0] r_adc_channels_2,                          // [1,23,0]
    output wire signed [23:0] r_adc_channels_3,                          // [1,23,0]
    output wire signed [23:0] r_adc_channels_4,                          // [1,23,0]
    output wire signed [23:0] r_adc_channels_5,                          // [1,23,0]
    output wire signed [23:0] r_adc_channels_6,                          // [1,23,0]
    output wire signed [23:0] r_adc_channels_7,                          // [1,23,0]
    output wire               r_adc_valid,
    output wire               r_adc_ok,
    output wire         [3:0] r_sid_refs_0,                              // [0,4,0]
    output wire         [3:0] r_sid_refs_1,                              // [0,4,0]
    output wire         [3:0] r_sid_refs_2,                              // [0,4,0]
    output wire         [3:0] r_sid_refs_3,                              // [0,4,0]
    output wire signed [24:0] r_sid_acc_0,                               // [1,24,0]
    output wire signed [24:0] r_sid_acc_1,                               // [1,24,0]
    output wire signed [24:0] r_sid_acc_2,                               // [1,24,0]
    output wire signed [24:0] r_sid_acc_3,                               // [1,24,0]
    output wire signed [40:0] r_sid_pole1_0,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole1_1,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole1_2,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole1_3,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole2_0,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole2_1,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole2_2,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole2_3,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole3_0,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole3_1,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole3_2,                             // [1,24,16]
    output wire signed [40:0] r_sid_pole3_3,                             // [1,24,16]
    output wire         [1:0] r_sid_stage,                               // [0,2,0]
    output wire signed [23:0] r_sid_codes_0,                             // [1,23,0]
    output wire signed [23:0] r_sid_codes_1,                             // [1,23,0]
    output wire signed [23:0] r_sid_codes_2,                             // [1,23,0]
    output wire signed [23:0] r_sid_codes_3,                             // [1,23,0]
    output wire               r_sid_valid,
    output wire signed [17:0] r_sid_last_0,                              // [1,17,0]
    output wire signed [17:0] r_sid_last_1,                              // [1,17,0]
    output wire        [11:0] r_sid_still,                               // [0,12,0]
    output wire               r_sid_ok,
    output wire         [9:0] r_watchdog_age,                            // [0,10,0]
    output wire               r_watchdog_stale,
    output wire         [8:0] r_registers_control,                       // [0,9,0]
    output wire         [7:0] r_registers_fault_clear,                   // [0,8,0]
    output wire        [DDS_BITS-1:0] r_registers_phase_drive_sine,      // [0,0,48]
    output wire        [DDS_BITS-1:0] r_registers_phase_sense_sine,      // [0,0,48]
    output wire        [DDS_BITS-1:0] r_registers_phase_drive_ref,       // [0,0,48]
    output wire        [DDS_BITS-1:0] r_registers_phase_sense_ref,       // [0,0,48]
    output wire        [23:0] r_registers_amplitude_setpoint,            // [0,24,0]
    output wire        [DDS_BITS-1:0] r_registers_frequency_fixed,       // [0,0,48]
    output wire signed [23:0] r_registers_amplitude_fixed,               // [1,0,23]
    output wire signed [23:0] r_registers_rate_fixed,                    // [1,0,23]
    output wire        [31:0] r_registers_quadrature_fixed,              // [0,32,0]
    output wire signed [31:0] r_registers_rate_bias,                     // [1,23,8]
    output wire signed [31:0] r_registers_rate_bias_t1,                  // [1,7,24]
    output wire signed [31:0] r_registers_rate_bias_t2,                  // [1,7,24]
    output wire signed [29:0] r_registers_rate_scale,                    // [1,1,28]
    output wire signed [23:0] r_registers_rate_scale_t1,                 // [1,-17,40]
    output wire signed [23:0] r_registers_rate_scale_t2,                 // [1,-17,40]
    output wire         [2:0] r_registers_decimation,                    // [0,3,0]
    output wire        [CORDIC_GUARD_BITS+24:0] r_control_cordic_x,      // [0,25,8]
    output wire signed [CORDIC_GUARD_BITS+24:0] r_control_cordic_y,      // [1,24,8]
    output wire signed [CORDIC_GUARD_BITS+23:0] r_control_cordic_angle,  // [1,-1,32]
    output wire         [4:0] r_control_cordic_i,                        // [0,5,0]
    output wire               r_control_cordic_busy,
    output wire               r_control_cordic_done,
    output wire        [24:0] r_control_cordic_magnitude,                // [0,25,0]
    output wire signed [23:0] r_control_cordic_phase,                    // [1,-1,24]
    output wire signed [25:0] r_control_agc_error,                       // [1,25,0]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_control_agc_loop_prop, // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_control_agc_loop_acc, // [1,35,24]
    output wire signed [35:0] r_control_agc_loop_y,                      // [1,35,0]
    output wire signed [23:0] r_control_frequency_tracker_error,         // [1,-1,24]
    output wire        [DDS_BITS-1:0] r_control_frequency_tracker_centre, // [0,0,48]
    output wire        [DDS_BITS-1:0] r_control_frequency_tracker_word,  // [0,0,48]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_control_frequency_tracker_loop_prop, // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_control_frequency_tracker_loop_acc, // [1,35,24]
    output wire signed [35:0] r_control_frequency_tracker_loop_y,        // [1,35,0]
    output wire signed [23:0] r_control_rate_loop_error,                 // [1,23,0]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_control_rate_loop_loop_prop, // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_control_rate_loop_loop_acc, // [1,35,24]
    output wire signed [35:0] r_control_rate_loop_loop_y,                // [1,35,0]
    output wire signed [24:0] r_control_quadrature_loop_error,           // [1,24,0]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_control_quadrature_loop_loop_prop, // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_control_quadrature_loop_loop_acc, // [1,35,24]
    output wire signed [35:0] r_control_quadrature_loop_loop_y,          // [1,35,0]
    output wire        [31:0] r_control_quadrature_loop_root_radicand,   // [0,32,0]
    output wire        [15:0] r_control_quadrature_loop_root_root,       // [0,16,0]
    output wire        [16:0] r_control_quadrature_loop_root_remainder,  // [0,17,0]
    output wire         [3:0] r_control_quadrature_loop_root_i,          // [0,4,0]
    output wire               r_control_quadrature_loop_root_busy,
    output wire               r_control_quadrature_loop_root_done,
    output wire        [15:0] r_control_quadrature_loop_root_y,          // [0,16,0]
    output wire         [4:0] r_control_rate_output_stage,               // [0,5,0]
    output wire signed [23:0] r_control_rate_output_word,                // [1,23,0]
    output wire signed [15:0] r_control_rate_output_t,                   // [1,15,0]
    output wire        [15:0] r_control_rate_output_t2,                  // [0,16,0]
    output wire signed [49:0] r_control_rate_output_bias,                // [1,25,24]
    output wire signed [29:0] r_control_rate_output_scale,               // [1,1,28]
    output wire signed [31:0] r_control_rate_output_corrected,           // [1,23,8]
    output wire signed [31:0] r_control_rate_output_scaled,              // [1,11,20]
    output wire signed [37:0] r_control_rate_output_acc,                 // [1,17,20]
    output wire         [5:0] r_control_rate_output_count,               // [0,6,0]
    output wire         [2:0] r_control_rate_output_k,                   // [0,3,0]
    output wire signed [31:0] r_control_rate_output_y,                   // [1,11,20]
    output wire               r_control_rate_output_valid,
    output wire         [3:0] r_control_sequencer_state,                 // [0,4,0]
    output wire        [15:0] r_control_sequencer_timer,                 // [0,16,0]
    output wire         [8:0] r_control_sequencer_control,               // [0,9,0]
    output wire signed [23:0] r_control_sequencer_last_phase,            // [1,-1,24]
    output wire signed [35:0] r_control_sequencer_rotation,              // [1,11,24]
    output wire signed [DDS_BITS-1:0] r_control_sequencer_correction,    // [1,-1,48]
    output wire         [7:0] r_control_sequencer_attempts,              // [0,8,0]
    output wire               r_control_sequencer_lost,
    output wire               r_control_sequencer_failed,
    output wire         [3:0] r_control_sequencer_lock_locked,           // [0,4,0]
    output wire        [11:0] r_control_sequencer_lock_count_0,          // [0,12,0]
    output wire        [11:0] r_control_sequencer_lock_count_1,          // [0,12,0]
    output wire        [11:0] r_control_sequencer_lock_count_2,          // [0,12,0]
    output wire        [11:0] r_control_sequencer_lock_count_3,          // [0,12,0]
    output wire signed [23:0] r_control_sequencer_faults_codes_0,        // [1,23,0]
    output wire signed [23:0] r_control_sequencer_faults_codes_1,        // [1,23,0]
    output wire signed [23:0] r_control_sequencer_faults_codes_2,        // [1,23,0]
    output wire signed [23:0] r_control_sequencer_faults_codes_3,        // [1,23,0]
    output wire        [11:0] r_control_sequencer_faults_over_range,     // [0,12,0]
    output wire        [11:0] r_control_sequencer_faults_stuck,          // [0,12,0]
    output wire        [11:0] r_control_sequencer_faults_drive,          // [0,12,0]
    output wire        [11:0] r_control_sequencer_faults_rate,           // [0,12,0]
    output wire        [11:0] r_control_sequencer_faults_rail,           // [0,12,0]
    output wire        [15:0] r_control_sequencer_faults_bad_frames,     // [0,16,0]
    output wire        [15:0] r_control_sequencer_faults_good_frames,    // [0,16,0]
    output wire         [7:0] r_control_sequencer_faults_flags,          // [0,8,0]
    output wire         [7:0] r_control_sequencer_faults_latch,          // [0,8,0]
    output wire               o_adc_cs_n,
    output wire               o_adc_sclk,
    output wire         [3:0] o_refs,                                    // sgn(sin), sgn(cos) of drive, then of sense
    output wire               o_drive_sync_n,
    output wire               o_drive_sclk_en,                           // 1: SCLK is clk, by an output cell
    output wire               o_drive_sdin,
    output wire               o_sense_sync_n,
    output wire               o_sense_sclk_en,
    output wire               o_sense_sdin,
    output wire               o_sense_ldac_n,
    output wire               o_quadrature_sync_n,
    output wire               o_quadrature_sclk_en,
    output wire               o_quadrature_sdin
);

    // clocks of a tick, and the slot in which the sequencer reads the bank
    localparam [4:0] CODE_TICK = 5'd1, LOAD_TICK = 5'd2;
    localparam [5:0] SLOT_SEQUENCER = 6'd31;

    // ticks from one frame of V_q to the next, less 1: ones that the number of its tick ends with
    localparam [31:0] QUADRATURE_HZ = quadrature_fast ? 32'd1000000 : 32'd500000;
    localparam [31:0] QUADRATURE_CLOCKS = TICK_CLOCKS * QUADRATURE_HZ;
    localparam [31:0] QUADRATURE_MASK =
        (QUADRATURE_CLOCKS      >= MASTER_HZ) ? 32'd0 :
        (QUADRATURE_CLOCKS *  2 >= MASTER_HZ) ? 32'd1 :
        (QUADRATURE_CLOCKS *  4 >= MASTER_HZ) ? 32'd3 :
        (QUADRATURE_CLOCKS *  8 >= MASTER_HZ) ? 32'd7 :
        (QUADRATURE_CLOCKS * 16 >= MASTER_HZ) ? 32'd15 : 32'd31;
    localparam [$clog2(FRAME_TICKS)-1:0] QUADRATURE_ONES = QUADRATURE_MASK[$clog2(FRAME_TICKS)-1:0];

    wire ce_1m, ce_8k;
    wire at_code = (r_rates_tick == CODE_TICK);
    wire at_load = (r_rates_tick == LOAD_TICK);
    wire quadrature_load = at_load && (r_rates_frame & QUADRATURE_ONES) == QUADRATURE_ONES;

    wire frame = digital ? r_sid_valid : r_adc_valid;
    wire go = frame || (r_watchdog_stale && ce_8k);
    wire taken = (r_rates_slot == SLOT_SEQUENCER);

    // the frame of codes that the 8 kHz work reads
    wire signed [23:0] code_drive_sin = digital ? r_sid_codes_0 : r_adc_channels_0;
    wire signed [23:0] code_drive_cos = digital ? r_sid_codes_1 : r_adc_channels_1;
    wire signed [23:0] code_sense_sin = digital ? r_sid_codes_2 : r_adc_channels_2;
    wire signed [23:0] code_sense_cos = digital ? r_sid_codes_3 : r_adc_channels_3;
    wire signed [23:0] code_temperature = digital ? 24'sd0 : r_adc_channels_4;
    wire code_ok = digital ? r_sid_ok : r_adc_ok;

    wire signed [SINE_BITS-1:0] drive_carrier, sense_carrier;
    wire signed [23:0] amplitude;
    wire signed [19:0] drive_code, sense_code;
    wire dac_init;

    // word of a DAC frame: the control word in INIT if the part has one, else header and code
    function [23:0] dac_word;
        input        init;
        input [23:0] control_word;
        input [23:0] header;
        input [19:0] flip;
        input [19:0] data_mask;
        input  [3:0] tail;
        input [19:0] code;
        dac_word = (init && control_word != 24'd0) ? control_word :
                   header | ({4'd0, (code ^ flip) & data_mask} << tail);
    endfunction

    wire [23:0] drive_word = dac_word(dac_init, drive_dac_control, drive_dac_header, drive_dac_flip,
                                      drive_dac_data_mask, drive_dac_tail, drive_code);
    wire [23:0] sense_word = dac_word(dac_init, sense_dac_control, sense_dac_header, sense_dac_flip,
                                      sense_dac_data_mask, sense_dac_tail, sense_code);
    wire [23:0] quadrature_word = dac_word(dac_init, quadrature_dac_control, quadrature_dac_header, quadrature_dac_flip,
                                           quadrature_dac_data_mask, quadrature_dac_tail,
                                           {4'd0, r_control_quadrature_loop_root_y});

    assign o_adc_cs_n = r_adc_cs_n;
    assign o_adc_sclk = r_adc_sclk;
    assign o_drive_sync_n = r_drive_dac_sync_n;
    assign o_drive_sclk_en = r_drive_dac_sclk_en;
    assign o_sense_sync_n = r_sense_dac_sync_n;
    assign o_sense_sclk_en = r_sense_dac_sclk_en;
    assign o_sense_ldac_n = r_sense_dac_ldac_n;
    assign o_quadrature_sync_n = r_quadrature_dac_sync_n;
    assign o_quadrature_sclk_en = r_quadrature_dac_sclk_en;

    gyro_rates #(
        .TICK_CLOCKS(TICK_CLOCKS),
        .FRAME_TICKS(FRAME_TICKS)
    ) rates (
        .clk    (clk),
        .rst    (rst),
        .go     (go),
        .r_tick (r_rates_tick),
        .r_frame(r_rates_frame),
        .r_slot (r_rates_slot),
        .o_ce_1m(ce_1m),
        .o_ce_8k(ce_8k)
    );

    gyro_dds #(
        .DDS_BITS(DDS_BITS)
    ) dds (
        .clk           (clk),
        .rst           (rst),
        .word          (r_control_frequency_tracker_word),
        .off_drive_sine(r_registers_phase_drive_sine),
        .off_sense_sine(r_registers_phase_sense_sine),
        .off_drive_ref (r_registers_phase_drive_ref),
        .off_sense_ref (r_registers_phase_sense_ref),
        .r_phase       (r_dds_phase),
        .r_drive_sine  (r_dds_drive_sine),
        .r_sense_sine  (r_dds_sense_sine),
        .r_drive_ref   (r_dds_drive_ref),
        .r_sense_ref   (r_dds_sense_ref)
    );

    gyro_sine #(
        .DDS_BITS          (DDS_BITS),
        .SINE_ADDRESS_BITS (SINE_ADDRESS_BITS),
        .SINE_FRACTION_BITS(SINE_FRACTION_BITS),
        .SINE_BITS         (SINE_BITS),
        .ROM_FILE          (SINE_ROM_FILE)
    ) drive_sine (
        .clk       (clk),
        .rst       (rst),
        .phase     (r_dds_drive_sine),
        .r_sign    (r_drive_sine_sign),
        .r_base    (r_drive_sine_base),
        .r_slope   (r_drive_sine_slope),
        .r_fraction(r_drive_sine_fraction),
        .r_sign2   (r_drive_sine_sign2),
        .r_base2   (r_drive_sine_base2),
        .r_product (r_drive_sine_product),
        .r_y       (r_drive_sine_y)
    );

    gyro_sine #(
        .DDS_BITS          (DDS_BITS),
        .SINE_ADDRESS_BITS (SINE_ADDRESS_BITS),
        .SINE_FRACTION_BITS(SINE_FRACTION_BITS),
        .SINE_BITS         (SINE_BITS),
        .ROM_FILE          (SINE_ROM_FILE)
    ) sense_sine (
        .clk       (clk),
        .rst       (rst),
        .phase     (r_dds_sense_sine),
        .r_sign    (r_sense_sine_sign),
        .r_base    (r_sense_sine_base),
        .r_slope   (r_sense_sine_slope),
        .r_fraction(r_sense_sine_fraction),
        .r_sign2   (r_sense_sine_sign2),
        .r_base2   (r_sense_sine_base2),
        .r_product (r_sense_sine_product),
        .r_y       (r_sense_sine_y)
    );

    gyro_delay #(
        .SINE_BITS(SINE_BITS),
        .depth    (pipe_depth)
    ) drive_pipe (
        .clk     (clk),
        .rst     (rst),
        .x       (r_drive_sine_y),
        .r_taps_0(r_drive_pipe_taps_0),
        .r_taps_1(r_drive_pipe_taps_1),
        .r_taps_2(r_drive_pipe_taps_2),
        .r_taps_3(r_drive_pipe_taps_3),
        .r_taps_4(r_drive_pipe_taps_4),
        .r_taps_5(r_drive_pipe_taps_5),
        .r_taps_6(r_drive_pipe_taps_6),
        .r_taps_7(r_drive_pipe_taps_7),
        .o_out   (drive_carrier)
    );

    gyro_delay #(
        .SINE_BITS(SINE_BITS),
        .depth    (pipe_depth)
    ) sense_pipe (
        .clk     (clk),
        .rst     (rst),
        .x       (r_sense_sine_y),
        .r_taps_0(r_sense_pipe_taps_0),
        .r_taps_1(r_sense_pipe_taps_1),
        .r_taps_2(r_sense_pipe_taps_2),
        .r_taps_3(r_sense_pipe_taps_3),
        .r_taps_4(r_sense_pipe_taps_4),
        .r_taps_5(r_sense_pipe_taps_5),
        .r_taps_6(r_sense_pipe_taps_6),
        .r_taps_7(r_sense_pipe_taps_7),
        .o_out   (sense_carrier)
    );

    gyro_references #(
        .DDS_BITS(DDS_BITS),
        .align   (references_align),
        .retimed (references_retimed)
    ) references (
        .clk        (clk),
        .rst        (rst),
        .drive_ref  (r_dds_drive_ref),
        .sense_ref  (r_dds_sense_ref),
        .ce_1m      (ce_1m),
        .r_signs    (r_references_signs),
        .r_aligned_0(r_references_aligned_0),
        .r_aligned_1(r_references_aligned_1),
        .r_aligned_2(r_references_aligned_2),
        .r_retimed  (r_references_retimed),
        .o_pins     (o_refs)
    );

    gyro_modulator #(
        .SINE_BITS(SINE_BITS),
        .shift    (drive_modulator_shift),
        .lo       (drive_modulator_lo),
        .hi       (drive_modulator_hi),
        .frames   (drive_modulator_frames)
    ) drive_modulator (
        .clk       (clk),
        .rst       (rst),
        .en_product(ce_1m),
        .en_code   (at_code),
        .amplitude (amplitude),
        .sine      (drive_carrier),
        .r_product (r_drive_modulator_product),
        .r_code    (r_drive_modulator_code),
        .r_held1   (r_drive_modulator_held1),
        .r_held2   (r_drive_modulator_held2),
        .o_out     (drive_code)
    );

    gyro_modulator #(
        .SINE_BITS(SINE_BITS),
        .shift    (sense_modulator_shift),
        .lo       (sense_modulator_lo),
        .hi       (sense_modulator_hi),
        .frames   (sense_modulator_frames)
    ) sense_modulator (
        .clk       (clk),
        .rst       (rst),
        .en_product(ce_1m),
        .en_code   (at_code),
        .amplitude (r_control_rate_loop_loop_y[23:0]),
        .sine      (sense_carrier),
        .r_product (r_sense_modulator_product),
        .r_code    (r_sense_modulator_code),
        .r_held1   (r_sense_modulator_held1),
        .r_held2   (r_sense_modulator_held2),
        .o_out     (sense_code)
    );

    gyro_spi_dac #(
        .bits     (drive_dac_bits),
        .lead     (drive_dac_lead),
        .ldac     (drive_dac_ldac),
        .flip     (drive_dac_flip),
        .header   (drive_dac_header),
        .control  (drive_dac_control),
        .data_mask(drive_dac_data_mask),
        .tail     (drive_dac_tail),
        .gap      (drive_dac_gap),
        .strobe   (drive_dac_strobe)
    ) drive_dac (
        .clk        (clk),
        .rst        (rst),
        .load       (at_load),
        .word       (drive_word),
        .r_shift    (r_drive_dac_shift),
        .r_left     (r_drive_dac_left),
        .r_lead     (r_drive_dac_lead),
        .r_sync_n   (r_drive_dac_sync_n),
        .r_sclk_en  (r_drive_dac_sclk_en),
        .r_ldac_n   (r_drive_dac_ldac_n),
        .r_ldac_wait(r_drive_dac_ldac_wait),
        .o_sdin     (o_drive_sdin)
    );

    gyro_spi_dac #(
        .bits     (sense_dac_bits),
        .lead     (sense_dac_lead),
        .ldac     (sense_dac_ldac),
        .flip     (sense_dac_flip),
        .header   (sense_dac_header),
        .control  (sense_dac_control),
        .data_mask(sense_dac_data_mask),
        .tail     (sense_dac_tail),
        .gap      (sense_dac_gap),
        .strobe   (sense_dac_strobe)
    ) sense_dac (
        .clk        (clk),
        .rst        (rst),
        .load       (at_load),
        .word       (sense_word),
        .r_shift    (r_sense_dac_shift),
        .r_left     (r_sense_dac_left),
        .r_lead     (r_sense_dac_lead),
        .r_sync_n   (r_sense_dac_sync_n),
        .r_sclk_en  (r_sense_dac_sclk_en),
        .r_ldac_n   (r_sense_dac_ldac_n),
        .r_ldac_wait(r_sense_dac_ldac_wait),
        .o_sdin     (o_sense_sdin)
    );

    gyro_spi_dac #(
        .bits     (quadrature_dac_bits),
        .lead     (quadrature_dac_lead),
        .ldac     (quadrature_dac_ldac),
        .flip     (quadrature_dac_flip),
        .header   (quadrature_dac_header),
        .control  (quadrature_dac_control),
        .data_mask(quadrature_dac_data_mask),
        .tail     (quadrature_dac_tail),
        .gap      (quadrature_dac_gap),
        .strobe   (quadrature_dac_strobe)
    ) quadrature_dac (
        .clk        (clk),
        .rst        (rst),
        .load       (quadrature_load),
        .word       (quadrature_word),
        .r_shift    (r_quadrature_dac_shift),
        .r_left     (r_quadrature_dac_left),
        .r_lead     (r_quadrature_dac_lead),
        .r_sync_n   (r_quadrature_dac_sync_n),
        .r_sclk_en  (r_quadrature_dac_sclk_en),
        .r_ldac_n   (r_quadrature_dac_ldac_n),
        .r_ldac_wait(r_quadrature_dac_ldac_wait),
        .o_sdin     (o_quadrature_sdin)
    );

    gyro_spi_adc #(
        .ADC_DIVIDER    (ADC_DIVIDER),
        .ADC_WORD_BITS  (ADC_WORD_BITS),
        .ADC_CHANNELS   (ADC_CHANNELS),
        .ADC_TAIL_CLOCKS(ADC_TAIL_CLOCKS)
    ) adc (
        .clk         (clk),
        .rst         (rst),
        .drdy_n      (drdy_n),
        .dout        (dout),
        .r_meta      (r_adc_meta),
        .r_sync      (r_adc_sync),
        .r_seen      (r_adc_seen),
        .r_busy      (r_adc_busy),
        .r_count     (r_adc_count),
        .r_cs_n      (r_adc_cs_n),
        .r_sclk      (r_adc_sclk),
        .r_shift     (r_adc_shift),
        .r_word      (r_adc_word),
        .r_status    (r_adc_status),
        .r_channels_0(r_adc_channels_0),
        .r_channels_1(r_adc_channels_1),
        .r_channels_2(r_adc_channels_2),
        .r_channels_3(r_adc_channels_3),
        .r_channels_4(r_adc_channels_4),
        .r_channels_5(r_adc_channels_5),
        .r_channels_6(r_adc_channels_6),
        .r_channels_7(r_adc_channels_7),
        .r_valid     (r_adc_valid),
        .r_ok        (r_adc_ok)
    );

    // without it the board has an analog demodulator, and these registers rest
    gyro_digital_sid #(
        .alpha    (sid_alpha),
        .gain_x   (sid_gain_x),
        .gain_y   (sid_gain_y),
        .ref_delay(sid_ref_delay),
        .still    (sid_still)
    ) sid (
        .clk      (clk),
        .rst      (rst),
        .ce_1m    (ce_1m && digital),
        .dump     (ce_8k),
        .refs     (o_refs),
        .sample_x (sample_x),
        .sample_y (sample_y),
        .r_refs_0 (r_sid_refs_0),
        .r_refs_1 (r_sid_refs_1),
        .r_refs_2 (r_sid_refs_2),
        .r_refs_3 (r_sid_refs_3),
        .r_acc_0  (r_sid_acc_0),
        .r_acc_1  (r_sid_acc_1),
        .r_acc_2  (r_sid_acc_2),
        .r_acc_3  (r_sid_acc_3),
        .r_pole1_0(r_sid_pole1_0),
        .r_pole1_1(r_sid_pole1_1),
        .r_pole1_2(r_sid_pole1_2),
        .r_pole1_3(r_sid_pole1_3),
        .r_pole2_0(r_sid_pole2_0),
        .r_pole2_1(r_sid_pole2_1),
        .r_pole2_2(r_sid_pole2_2),
        .r_pole2_3(r_sid_pole2_3),
        .r_pole3_0(r_sid_pole3_0),
        .r_pole3_1(r_sid_pole3_1),
        .r_pole3_2(r_sid_pole3_2),
        .r_pole3_3(r_sid_pole3_3),
        .r_stage  (r_sid_stage),
        .r_codes_0(r_sid_codes_0),
        .r_codes_1(r_sid_codes_1),
        .r_codes_2(r_sid_codes_2),
        .r_codes_3(r_sid_codes_3),
        .r_valid  (r_sid_valid),
        .r_last_0 (r_sid_last_0),
        .r_last_1 (r_sid_last_1),
        .r_still  (r_sid_still),
        .r_ok     (r_sid_ok)
    );

    gyro_watchdog #(
        .limit(watchdog_limit)
    ) watchdog (
        .clk    (clk),
        .rst    (rst),
        .ce_1m  (ce_1m),
        .frame  (frame),
        .r_age  (r_watchdog_age),
        .r_stale(r_watchdog_stale)
    );

    gyro_registers #(
        .MASTER_HZ(MASTER_HZ),
        .DDS_BITS (DDS_BITS)
    ) registers (
        .clk                 (clk),
        .rst                 (rst),
        .write               (write),
        .address             (address),
        .data                (data),
        .taken               (taken),
        .r_control           (r_registers_control),
        .r_fault_clear       (r_registers_fault_clear),
        .r_phase_drive_sine  (r_registers_phase_drive_sine),
        .r_phase_sense_sine  (r_registers_phase_sense_sine),
        .r_phase_drive_ref   (r_registers_phase_drive_ref),
        .r_phase_sense_ref   (r_registers_phase_sense_ref),
        .r_amplitude_setpoint(r_registers_amplitude_setpoint),
        .r_frequency_fixed   (r_registers_frequency_fixed),
        .r_amplitude_fixed   (r_registers_amplitude_fixed),
        .r_rate_fixed        (r_registers_rate_fixed),
        .r_quadrature_fixed  (r_registers_quadrature_fixed),
        .r_rate_bias         (r_registers_rate_bias),
        .r_rate_bias_t1      (r_registers_rate_bias_t1),
        .r_rate_bias_t2      (r_registers_rate_bias_t2),
        .r_rate_scale        (r_registers_rate_scale),
        .r_rate_scale_t1     (r_registers_rate_scale_t1),
        .r_rate_scale_t2     (r_registers_rate_scale_t2),
        .r_decimation        (r_registers_decimation)
    );

    gyro_control #(
        .MASTER_HZ                  (MASTER_HZ),
        .DDS_BITS                   (DDS_BITS),
        .CORDIC_ITERATIONS          (CORDIC_ITERATIONS),
        .CORDIC_GUARD_BITS          (CORDIC_GUARD_BITS),
        .ACCUMULATOR_FRACTION_BITS  (ACCUMULATOR_FRACTION_BITS),
        .agc_loop_kp                (control_agc_loop_kp),
        .agc_loop_ki                (control_agc_loop_ki),
        .agc_loop_lo                (control_agc_loop_lo),
        .agc_loop_hi                (control_agc_loop_hi),
        .agc_kick                   (control_agc_kick),
        .frequency_tracker_loop_kp  (control_frequency_tracker_loop_kp),
        .frequency_tracker_loop_ki  (control_frequency_tracker_loop_ki),
        .frequency_tracker_loop_lo  (control_frequency_tracker_loop_lo),
        .frequency_tracker_loop_hi  (control_frequency_tracker_loop_hi),
        .rate_loop_loop_kp          (control_rate_loop_loop_kp),
        .rate_loop_loop_ki          (control_rate_loop_loop_ki),
        .rate_loop_loop_lo          (control_rate_loop_loop_lo),
        .rate_loop_loop_hi          (control_rate_loop_loop_hi),
        .quadrature_loop_loop_kp    (control_quadrature_loop_loop_kp),
        .quadrature_loop_loop_ki    (control_quadrature_loop_loop_ki),
        .quadrature_loop_loop_lo    (control_quadrature_loop_loop_lo),
        .quadrature_loop_loop_hi    (control_quadrature_loop_loop_hi),
        .sequencer_power_up         (control_sequencer_power_up),
        .sequencer_init             (control_sequencer_init),
        .sequencer_kick             (control_sequencer_kick),
        .sequencer_decay            (control_sequencer_decay),
        .sequencer_search           (control_sequencer_search),
        .sequencer_retune           (control_sequencer_retune),
        .sequencer_timeout          (control_sequencer_timeout),
        .sequencer_offline          (control_sequencer_offline),
        .sequencer_recover          (control_sequencer_recover),
        .sequencer_reached          (control_sequencer_reached),
        .sequencer_min_magnitude    (control_sequencer_min_magnitude),
        .sequencer_gain             (control_sequencer_gain),
        .sequencer_search_limit     (control_sequencer_search_limit),
        .sequencer_lock_limit_in_0  (control_sequencer_lock_limit_in_0),
        .sequencer_lock_limit_in_1  (control_sequencer_lock_limit_in_1),
        .sequencer_lock_limit_in_2  (control_sequencer_lock_limit_in_2),
        .sequencer_lock_limit_in_3  (control_sequencer_lock_limit_in_3),
        .sequencer_lock_limit_out_0 (control_sequencer_lock_limit_out_0),
        .sequencer_lock_limit_out_1 (control_sequencer_lock_limit_out_1),
        .sequencer_lock_limit_out_2 (control_sequencer_lock_limit_out_2),
        .sequencer_lock_limit_out_3 (control_sequencer_lock_limit_out_3),
        .sequencer_lock_frames_in_0 (control_sequencer_lock_frames_in_0),
        .sequencer_lock_frames_in_1 (control_sequencer_lock_frames_in_1),
        .sequencer_lock_frames_in_2 (control_sequencer_lock_frames_in_2),
        .sequencer_lock_frames_in_3 (control_sequencer_lock_frames_in_3),
        .sequencer_lock_frames_out_0(control_sequencer_lock_frames_out_0),
        .sequencer_lock_frames_out_1(control_sequencer_lock_frames_out_1),
        .sequencer_lock_frames_out_2(control_sequencer_lock_frames_out_2),
        .sequencer_lock_frames_out_3(control_sequencer_lock_frames_out_3),
        .sequencer_faults_over_range(control_sequencer_faults_over_range),
        .sequencer_faults_stuck     (control_sequencer_faults_stuck),
        .sequencer_faults_drive     (control_sequencer_faults_drive),
        .sequencer_faults_rate      (control_sequencer_faults_rate),
        .sequencer_faults_rail      (control_sequencer_faults_rail),
        .sequencer_faults_top       (control_sequencer_faults_top),
        .CORDIC_ROM_FILE            (CORDIC_ROM_FILE)
    ) control (
        .clk                             (clk),
        .rst                             (rst),
        .slot                            (r_rates_slot),
        .drive_sin                       (code_drive_sin),
        .drive_cos                       (code_drive_cos),
        .sense_sin                       (code_sense_sin),
        .sense_cos                       (code_sense_cos),
        .temperature                     (code_temperature),
        .adc_ok                          (code_ok),
        .stale                           (r_watchdog_stale),
        .bank_control                    (r_registers_control),
        .bank_fault_clear                (r_registers_fault_clear),
        .bank_amplitude_setpoint         (r_registers_amplitude_setpoint),
        .bank_frequency_fixed            (r_registers_frequency_fixed),
        .bank_amplitude_fixed            (r_registers_amplitude_fixed),
        .bank_rate_fixed                 (r_registers_rate_fixed),
        .bank_quadrature_fixed           (r_registers_quadrature_fixed),
        .bank_rate_bias                  (r_registers_rate_bias),
        .bank_rate_bias_t1               (r_registers_rate_bias_t1),
        .bank_rate_bias_t2               (r_registers_rate_bias_t2),
        .bank_rate_scale                 (r_registers_rate_scale),
        .bank_rate_scale_t1              (r_registers_rate_scale_t1),
        .bank_rate_scale_t2              (r_registers_rate_scale_t2),
        .bank_decimation                 (r_registers_decimation),
        .r_cordic_x                      (r_control_cordic_x),
        .r_cordic_y                      (r_control_cordic_y),
        .r_cordic_angle                  (r_control_cordic_angle),
        .r_cordic_i                      (r_control_cordic_i),
        .r_cordic_busy                   (r_control_cordic_busy),
        .r_cordic_done                   (r_control_cordic_done),
        .r_cordic_magnitude              (r_control_cordic_magnitude),
        .r_cordic_phase                  (r_control_cordic_phase),
        .r_agc_error                     (r_control_agc_error),
        .r_agc_loop_prop                 (r_control_agc_loop_prop),
        .r_agc_loop_acc                  (r_control_agc_loop_acc),
        .r_agc_loop_y                    (r_control_agc_loop_y),
        .r_frequency_tracker_error       (r_control_frequency_tracker_error),
        .r_frequency_tracker_centre      (r_control_frequency_tracker_centre),
        .r_frequency_tracker_word        (r_control_frequency_tracker_word),
        .r_frequency_tracker_loop_prop   (r_control_frequency_tracker_loop_prop),
        .r_frequency_tracker_loop_acc    (r_control_frequency_tracker_loop_acc),
        .r_frequency_tracker_loop_y      (r_control_frequency_tracker_loop_y),
        .r_rate_loop_error               (r_control_rate_loop_error),
        .r_rate_loop_loop_prop           (r_control_rate_loop_loop_prop),
        .r_rate_loop_loop_acc            (r_control_rate_loop_loop_acc),
        .r_rate_loop_loop_y              (r_control_rate_loop_loop_y),
        .r_quadrature_loop_error         (r_control_quadrature_loop_error),
        .r_quadrature_loop_loop_prop     (r_control_quadrature_loop_loop_prop),
        .r_quadrature_loop_loop_acc      (r_control_quadrature_loop_loop_acc),
        .r_quadrature_loop_loop_y        (r_control_quadrature_loop_loop_y),
        .r_quadrature_loop_root_radicand (r_control_quadrature_loop_root_radicand),
        .r_quadrature_loop_root_root     (r_control_quadrature_loop_root_root),
        .r_quadrature_loop_root_remainder(r_control_quadrature_loop_root_remainder),
        .r_quadrature_loop_root_i        (r_control_quadrature_loop_root_i),
        .r_quadrature_loop_root_busy     (r_control_quadrature_loop_root_busy),
        .r_quadrature_loop_root_done     (r_control_quadrature_loop_root_done),
        .r_quadrature_loop_root_y        (r_control_quadrature_loop_root_y),
        .r_rate_output_stage             (r_control_rate_output_stage),
        .r_rate_output_word              (r_control_rate_output_word),
        .r_rate_output_t                 (r_control_rate_output_t),
        .r_rate_output_t2                (r_control_rate_output_t2),
        .r_rate_output_bias              (r_control_rate_output_bias),
        .r_rate_output_scale             (r_control_rate_output_scale),
        .r_rate_output_corrected         (r_control_rate_output_corrected),
        .r_rate_output_scaled            (r_control_rate_output_scaled),
        .r_rate_output_acc               (r_control_rate_output_acc),
        .r_rate_output_count             (r_control_rate_output_count),
        .r_rate_output_k                 (r_control_rate_output_k),
        .r_rate_output_y                 (r_control_rate_output_y),
        .r_rate_output_valid             (r_control_rate_output_valid),
        .r_sequencer_state               (r_control_sequencer_state),
        .r_sequencer_timer               (r_control_sequencer_timer),
        .r_sequencer_control             (r_control_sequencer_control),
        .r_sequencer_last_phase          (r_control_sequencer_last_phase),
        .r_sequencer_rotation            (r_control_sequencer_rotation),
        .r_sequencer_correction          (r_control_sequencer_correction),
        .r_sequencer_attempts            (r_control_sequencer_attempts),
        .r_sequencer_lost                (r_control_sequencer_lost),
        .r_sequencer_failed              (r_control_sequencer_failed),
        .r_sequencer_lock_locked         (r_control_sequencer_lock_locked),
        .r_sequencer_lock_count_0        (r_control_sequencer_lock_count_0),
        .r_sequencer_lock_count_1        (r_control_sequencer_lock_count_1),
        .r_sequencer_lock_count_2        (r_control_sequencer_lock_count_2),
        .r_sequencer_lock_count_3        (r_control_sequencer_lock_count_3),
        .r_sequencer_faults_codes_0      (r_control_sequencer_faults_codes_0),
        .r_sequencer_faults_codes_1      (r_control_sequencer_faults_codes_1),
        .r_sequencer_faults_codes_2      (r_control_sequencer_faults_codes_2),
        .r_sequencer_faults_codes_3      (r_control_sequencer_faults_codes_3),
        .r_sequencer_faults_over_range   (r_control_sequencer_faults_over_range),
        .r_sequencer_faults_stuck        (r_control_sequencer_faults_stuck),
        .r_sequencer_faults_drive        (r_control_sequencer_faults_drive),
        .r_sequencer_faults_rate         (r_control_sequencer_faults_rate),
        .r_sequencer_faults_rail         (r_control_sequencer_faults_rail),
        .r_sequencer_faults_bad_frames   (r_control_sequencer_faults_bad_frames),
        .r_sequencer_faults_good_frames  (r_control_sequencer_faults_good_frames),
        .r_sequencer_faults_flags        (r_control_sequencer_faults_flags),
        .r_sequencer_faults_latch        (r_control_sequencer_faults_latch),
        .o_amplitude                     (amplitude),
        .o_dac_init                      (dac_init)
    );

endmodule
