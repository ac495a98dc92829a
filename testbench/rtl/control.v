// Wiring of the 8 kHz work: codes to loops to words, in slots of one clock each after a valid frame.
//   slot 1 CORDIC, 31 sequencer, 32 errors, 33 the four PIs, 36 root of u and output stage of the rate, 60 the last
// Latency: 53 clocks from slot 1 to the last word. Rounding and overflow are those of the blocks; -drive_cos saturates.
// Outside the window no enable holds the blocks: with slot = 0 no strobe is high, the 60 slots outlast every pipeline,
// so that what still runs loads what it holds. For this the limits of each loop must include 0, its output at reset.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_control #(
    parameter        [31:0] MASTER_HZ                   = 32'd26000000,
    parameter               DDS_BITS                    = 48,
    parameter               CORDIC_ITERATIONS           = 24,
    parameter               CORDIC_GUARD_BITS           = 8,
    parameter               ACCUMULATOR_FRACTION_BITS   = 24,
    parameter signed [33:0] agc_loop_kp                 = 34'sd0,  // [1,9,24]
    parameter signed [33:0] agc_loop_ki                 = 34'sd0,  // [1,9,24]
    parameter signed [35:0] agc_loop_lo                 = 36'sd0,  // [1,35,0]
    parameter signed [35:0] agc_loop_hi                 = 36'sd0,  // [1,35,0]
    parameter signed [23:0] agc_kick                    = 24'sd0,  // [1,0,23]
    parameter signed [33:0] frequency_tracker_loop_kp   = 34'sd0,  // [1,9,24]
    parameter signed [33:0] frequency_tracker_loop_ki   = 34'sd0,  // [1,9,24]
    parameter signed [35:0] frequency_tracker_loop_lo   = 36'sd0,  // [1,35,0]
    parameter signed [35:0] frequency_tracker_loop_hi   = 36'sd0,  // [1,35,0]
    parameter signed [33:0] rate_loop_loop_kp           = 34'sd0,  // [1,9,24]
    parameter signed [33:0] rate_loop_loop_ki           = 34'sd0,  // [1,9,24]
    parameter signed [35:0] rate_loop_loop_lo           = 36'sd0,  // [1,35,0]
    parameter signed [35:0] rate_loop_loop_hi           = 36'sd0,  // [1,35,0]
    parameter signed [33:0] quadrature_loop_loop_kp     = 34'sd0,  // [1,9,24]
    parameter signed [33:0] quadrature_loop_loop_ki     = 34'sd0,  // [1,9,24]
    parameter signed [35:0] quadrature_loop_loop_lo     = 36'sd0,  // [1,35,0]
    parameter signed [35:0] quadrature_loop_loop_hi     = 36'sd0,  // [1,35,0]
    parameter        [15:0] sequencer_power_up          = 16'd0,   // [0,16,0]
    parameter        [15:0] sequencer_init              = 16'd0,   // [0,16,0]
    parameter        [15:0] sequencer_kick              = 16'd0,   // [0,16,0]
    parameter        [15:0] sequencer_decay             = 16'd0,   // [0,16,0]
    parameter        [15:0] sequencer_search            = 16'd0,   // [0,16,0]
    parameter        [15:0] sequencer_retune            = 16'd0,   // [0,16,0]
    parameter        [15:0] sequencer_timeout           = 16'd0,   // [0,16,0]
    parameter        [15:0] sequencer_offline           = 16'd0,   // [0,16,0]
    parameter        [15:0] sequencer_recover           = 16'd0,   // [0,16,0]
    parameter        [16:0] sequencer_reached           = 17'd0,   // [0,17,0]
    parameter        [24:0] sequencer_min_magnitude     = 25'd0,   // [0,25,0]
    parameter        [23:0] sequencer_gain              = 24'd0,   // [0,8,16]
    parameter signed [DDS_BITS-1:0] sequencer_search_limit = 0,       // [1,-1,48]
    parameter        [23:0] sequencer_lock_limit_in_0   = 24'd0,   // [0,24,0]
    parameter        [23:0] sequencer_lock_limit_in_1   = 24'd0,   // [0,24,0]
    parameter        [23:0] sequencer_lock_limit_in_2   = 24'd0,   // [0,24,0]
    parameter        [23:0] sequencer_lock_limit_in_3   = 24'd0,   // [0,24,0]
    parameter        [23:0] sequencer_lock_limit_out_0  = 24'd0,   // [0,24,0]
    parameter        [23:0] sequencer_lock_limit_out_1  = 24'd0,   // [0,24,0]
    parameter        [23:0] sequencer_lock_limit_out_2  = 24'd0,   // [0,24,0]
    parameter        [23:0] sequencer_lock_limit_out_3  = 24'd0,   // [0,24,0]
    parameter        [11:0] sequencer_lock_frames_in_0  = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_lock_frames_in_1  = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_lock_frames_in_2  = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_lock_frames_in_3  = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_lock_frames_out_0 = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_lock_frames_out_1 = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_lock_frames_out_2 = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_lock_frames_out_3 = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_faults_over_range = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_faults_stuck      = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_faults_drive      = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_faults_rate       = 12'd0,   // [0,12,0]
    parameter        [11:0] sequencer_faults_rail       = 12'd0,   // [0,12,0]
    parameter        [15:0] sequencer_faults_top        = 16'hFFFF, // [0,16,0]
    parameter               CORDIC_ROM_FILE             = ""
) (
    input  wire               clk,
    input  wire               rst,                               // synchronous, active high
    input  wire         [5:0] slot,                              // 0 outside the window
    input  wire signed [23:0] drive_sin,                         // [1,23,0]
    input  wire signed [23:0] drive_cos,                         // [1,23,0]
    input  wire signed [23:0] sense_sin,                         // [1,23,0]
    input  wire signed [23:0] sense_cos,                         // [1,23,0]
    input  wire signed [23:0] temperature,                       // [1,23,0]
    input  wire               adc_ok,
    input  wire               stale,
    input  wire         [8:0] bank_control,                      // [0,9,0]
    input  wire         [7:0] bank_fault_clear,                  // [0,8,0]
    input  wire        [23:0] bank_amplitude_setpoint,           // [0,24,0]
    input  wire        [DDS_BITS-1:0] bank_frequency_fixed,      // [0,0,48]
    input  wire signed [23:0] bank_amplitude_fixed,              // [1,0,23]
    input  wire signed [23:0] bank_rate_fixed,                   // [1,0,23]
    input  wire        [31:0] bank_quadrature_fixed,             // [0,32,0]
    input  wire signed [31:0] bank_rate_bias,                    // [1,23,8]
    input  wire signed [31:0] bank_rate_bias_t1,                 // [1,7,24]
    input  wire signed [31:0] bank_rate_bias_t2,                 // [1,7,24]
    input  wire signed [29:0] bank_rate_scale,                   // [1,1,28]
    input  wire signed [23:0] bank_rate_scale_t1,                // [1,-17,40]
    input  wire signed [23:0] bank_rate_scale_t2,                // [1,-17,40]
    input  wire         [2:0] bank_decimation,                   // [0,3,0]
    output wire        [CORDIC_GUARD_BITS+24:0] r_cordic_x,      // [0,25,8]
    output wire signed [CORDIC_GUARD_BITS+24:0] r_cordic_y,      // [1,24,8]
    output wire signed [CORDIC_GUARD_BITS+23:0] r_cordic_angle,  // [1,-1,32]
    output wire         [4:0] r_cordic_i,                        // [0,5,0]
    output wire               r_cordic_busy,
    output wire               r_cordic_done,
    output wire        [24:0] r_cordic_magnitude,                // [0,25,0]
    output wire signed [23:0] r_cordic_phase,                    // [1,-1,24]
    output wire signed [25:0] r_agc_error,                       // [1,25,0]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_agc_loop_prop, // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_agc_loop_acc, // [1,35,24]
    output wire signed [35:0] r_agc_loop_y,                      // [1,35,0]
    output wire signed [23:0] r_frequency_tracker_error,         // [1,-1,24]
    output wire        [DDS_BITS-1:0] r_frequency_tracker_centre, // [0,0,48]
    output wire        [DDS_BITS-1:0] r_frequency_tracker_word,  // [0,0,48]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_frequency_tracker_loop_prop, // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_frequency_tracker_loop_acc, // [1,35,24]
    output wire signed [35:0] r_frequency_tracker_loop_y,        // [1,35,0]
    output wire signed [23:0] r_rate_loop_error,                 // [1,23,0]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_rate_loop_loop_prop, // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_rate_loop_loop_acc, // [1,35,24]
    output wire signed [35:0] r_rate_loop_loop_y,                // [1,35,0]
    output wire signed [24:0] r_quadrature_loop_error,           // [1,24,0]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_quadrature_loop_loop_prop, // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_quadrature_loop_loop_acc, // [1,35,24]
    output wire signed [35:0] r_quadrature_loop_loop_y,          // [1,35,0]
    output wire        [31:0] r_quadrature_loop_root_radicand,   // [0,32,0]
    output wire        [15:0] r_quadrature_loop_root_root,       // [0,16,0]
    output wire        [16:0] r_quadrature_loop_root_remainder,  // [0,17,0]
    output wire         [3:0] r_quadrature_loop_root_i,          // [0,4,0]
    output wire               r_quadrature_loop_root_busy,
    output wire               r_quadrature_loop_root_done,
    output wire        [15:0] r_quadrature_loop_root_y,          // [0,16,0]
    output wire         [4:0] r_rate_output_stage,               // [0,5,0]
    output wire signed [23:0] r_rate_output_word,                // [1,23,0]
    output wire signed [15:0] r_rate_output_t,                   // [1,15,0]
    output wire        [15:0] r_rate_output_t2,                  // [0,16,0]
    output wire signed [49:0] r_rate_output_bias,                // [1,25,24]
    output wire signed [29:0] r_rate_output_scale,               // [1,1,28]
    output wire signed [31:0] r_rate_output_corrected,           // [1,23,8]
    output wire signed [31:0] r_rate_output_scaled,              // [1,11,20]
    output wire signed [37:0] r_rate_output_acc,                 // [1,17,20]
    output wire         [5:0] r_rate_output_count,               // [0,6,0]
    output wire         [2:0] r_rate_output_k,                   // [0,3,0]
    output wire signed [31:0] r_rate_output_y,                   // [1,11,20]
    output wire               r_rate_output_valid,
    output wire         [3:0] r_sequencer_state,                 // [0,4,0]
    output wire        [15:0] r_sequencer_timer,                 // [0,16,0]
    output wire         [8:0] r_sequencer_control,               // [0,9,0]
    output wire signed [23:0] r_sequencer_last_phase,            // [1,-1,24]
    output wire signed [35:0] r_sequencer_rotation,              // [1,11,24]
    output wire signed [DDS_BITS-1:0] r_sequencer_correction,    // [1,-1,48]
    output wire         [7:0] r_sequencer_attempts,              // [0,8,0]
    output wire               r_sequencer_lost,
    output wire               r_sequencer_failed,
    output wire         [3:0] r_sequencer_lock_locked,           // [0,4,0]
    output wire        [11:0] r_sequencer_lock_count_0,          // [0,12,0]
    output wire        [11:0] r_sequencer_lock_count_1,          // [0,12,0]
    output wire        [11:0] r_sequencer_lock_count_2,          // [0,12,0]
    output wire        [11:0] r_sequencer_lock_count_3,          // [0,12,0]
    output wire signed [23:0] r_sequencer_faults_codes_0,        // [1,23,0]
    output wire signed [23:0] r_sequencer_faults_codes_1,        // [1,23,0]
    output wire signed [23:0] r_sequencer_faults_codes_2,        // [1,23,0]
    output wire signed [23:0] r_sequencer_faults_codes_3,        // [1,23,0]
    output wire        [11:0] r_sequencer_faults_over_range,     // [0,12,0]
    output wire        [11:0] r_sequencer_faults_stuck,          // [0,12,0]
    output wire        [11:0] r_sequencer_faults_drive,          // [0,12,0]
    output wire        [11:0] r_sequencer_faults_rate,           // [0,12,0]
    output wire        [11:0] r_sequencer_faults_rail,           // [0,12,0]
    output wire        [15:0] r_sequencer_faults_bad_frames,     // [0,16,0]
    output wire        [15:0] r_sequencer_faults_good_frames,    // [0,16,0]
    output wire         [7:0] r_sequencer_faults_flags,          // [0,8,0]
    output wire         [7:0] r_sequencer_faults_latch,          // [0,8,0]
    output wire signed [23:0] o_amplitude,                       // [1,0,23] of 10 V, the kick included
    output wire               o_dac_init
);

    localparam [5:0] SLOT_CORDIC = 6'd1, SLOT_SEQUENCER = 6'd31, SLOT_LOOPS = 6'd32, SLOT_PI = 6'd33, SLOT_ROOT = 6'd36;
    localparam signed [23:0] CODE_LO = 24'sh800000, CODE_HI = 24'sh7FFFFF;

    wire at_cordic = (slot == SLOT_CORDIC);
    wire at_sequencer = (slot == SLOT_SEQUENCER);
    wire at_loops = (slot == SLOT_LOOPS);
    wire at_pi = (slot == SLOT_PI);
    wire at_root = (slot == SLOT_ROOT);

    wire [2:0] agc_mode;
    wire [1:0] pll_mode, ftr_mode, qsc_mode;
    wire fix_drive, fix_ftr, fix_qsc, load, adjust;
    wire drive_saturated, rate_saturated, qsc_rail;
    /* verilator lint_off UNUSED */ // waived: for a status register; nothing on the board reads them
    wire drive_locked, locked, rate_good;
    /* verilator lint_on UNUSED */

    // the code of minus full scale has no opposite
    wire signed [23:0] minus_drive_cos = (drive_cos == CODE_LO) ? CODE_HI : -drive_cos;

    gyro_cordic #(
        .CORDIC_ITERATIONS(CORDIC_ITERATIONS),
        .CORDIC_GUARD_BITS(CORDIC_GUARD_BITS),
        .ROM_FILE         (CORDIC_ROM_FILE)
    ) cordic (
        .clk        (clk),
        .rst        (rst),
        .start      (at_cordic),
        .x_in       (minus_drive_cos),
        .y_in       (drive_sin),
        .r_x        (r_cordic_x),
        .r_y        (r_cordic_y),
        .r_angle    (r_cordic_angle),
        .r_i        (r_cordic_i),
        .r_busy     (r_cordic_busy),
        .r_done     (r_cordic_done),
        .r_magnitude(r_cordic_magnitude),
        .r_phase    (r_cordic_phase)
    );

    gyro_sequencer #(
        .DDS_BITS         (DDS_BITS),
        .power_up         (sequencer_power_up),
        .init             (sequencer_init),
        .kick             (sequencer_kick),
        .decay            (sequencer_decay),
        .search           (sequencer_search),
        .retune           (sequencer_retune),
        .timeout          (sequencer_timeout),
        .offline          (sequencer_offline),
        .recover          (sequencer_recover),
        .reached          (sequencer_reached),
        .min_magnitude    (sequencer_min_magnitude),
        .gain             (sequencer_gain),
        .search_limit     (sequencer_search_limit),
        .lock_limit_in_0  (sequencer_lock_limit_in_0),
        .lock_limit_in_1  (sequencer_lock_limit_in_1),
        .lock_limit_in_2  (sequencer_lock_limit_in_2),
        .lock_limit_in_3  (sequencer_lock_limit_in_3),
        .lock_limit_out_0 (sequencer_lock_limit_out_0),
        .lock_limit_out_1 (sequencer_lock_limit_out_1),
        .lock_limit_out_2 (sequencer_lock_limit_out_2),
        .lock_limit_out_3 (sequencer_lock_limit_out_3),
        .lock_frames_in_0 (sequencer_lock_frames_in_0),
        .lock_frames_in_1 (sequencer_lock_frames_in_1),
        .lock_frames_in_2 (sequencer_lock_frames_in_2),
        .lock_frames_in_3 (sequencer_lock_frames_in_3),
        .lock_frames_out_0(sequencer_lock_frames_out_0),
        .lock_frames_out_1(sequencer_lock_frames_out_1),
        .lock_frames_out_2(sequencer_lock_frames_out_2),
        .lock_frames_out_3(sequencer_lock_frames_out_3),
        .faults_over_range(sequencer_faults_over_range),
        .faults_stuck     (sequencer_faults_stuck),
        .faults_drive     (sequencer_faults_drive),
        .faults_rate      (sequencer_faults_rate),
        .faults_rail      (sequencer_faults_rail),
        .faults_top       (sequencer_faults_top)
    ) sequencer (
        .clk                 (clk),
        .rst                 (rst),
        .en                  (at_sequencer),
        .i_control           (bank_control),
        .i_clear             (bank_fault_clear),
        .i_adc_ok            (adc_ok),
        .i_stale             (stale),
        .i_drive_sin         (drive_sin),
        .i_drive_cos         (drive_cos),
        .i_sense_sin         (sense_sin),
        .i_sense_cos         (sense_cos),
        .i_magnitude         (r_cordic_magnitude),
        .i_phase             (r_cordic_phase),
        .i_setpoint          (bank_amplitude_setpoint),
        .i_drive_saturated   (drive_saturated),
        .i_rate_saturated    (rate_saturated),
        .i_qsc_rail          (qsc_rail),
        .r_state             (r_sequencer_state),
        .r_timer             (r_sequencer_timer),
        .r_control           (r_sequencer_control),
        .r_last_phase        (r_sequencer_last_phase),
        .r_rotation          (r_sequencer_rotation),
        .r_correction        (r_sequencer_correction),
        .r_attempts          (r_sequencer_attempts),
        .r_lost              (r_sequencer_lost),
        .r_failed            (r_sequencer_failed),
        .r_lock_locked       (r_sequencer_lock_locked),
        .r_lock_count_0      (r_sequencer_lock_count_0),
        .r_lock_count_1      (r_sequencer_lock_count_1),
        .r_lock_count_2      (r_sequencer_lock_count_2),
        .r_lock_count_3      (r_sequencer_lock_count_3),
        .r_faults_codes_0    (r_sequencer_faults_codes_0),
        .r_faults_codes_1    (r_sequencer_faults_codes_1),
        .r_faults_codes_2    (r_sequencer_faults_codes_2),
        .r_faults_codes_3    (r_sequencer_faults_codes_3),
        .r_faults_over_range (r_sequencer_faults_over_range),
        .r_faults_stuck      (r_sequencer_faults_stuck),
        .r_faults_drive      (r_sequencer_faults_drive),
        .r_faults_rate       (r_sequencer_faults_rate),
        .r_faults_rail       (r_sequencer_faults_rail),
        .r_faults_bad_frames (r_sequencer_faults_bad_frames),
        .r_faults_good_frames(r_sequencer_faults_good_frames),
        .r_faults_flags      (r_sequencer_faults_flags),
        .r_faults_latch      (r_sequencer_faults_latch),
        .o_agc_mode          (agc_mode),
        .o_pll_mode          (pll_mode),
        .o_ftr_mode          (ftr_mode),
        .o_qsc_mode          (qsc_mode),
        .o_fix_drive         (fix_drive),
        .o_fix_ftr           (fix_ftr),
        .o_fix_qsc           (fix_qsc),
        .o_dac_init          (o_dac_init),
        .o_load              (load),
        .o_adjust            (adjust),
        .o_drive_locked      (drive_locked),
        .o_locked            (locked),
        .o_rate_good         (rate_good)
    );

    gyro_agc #(
        .ACCUMULATOR_FRACTION_BITS(ACCUMULATOR_FRACTION_BITS),
        .loop_kp                  (agc_loop_kp),
        .loop_ki                  (agc_loop_ki),
        .loop_lo                  (agc_loop_lo),
        .loop_hi                  (agc_loop_hi),
        .kick                     (agc_kick)
    ) agc (
        .clk        (clk),
        .rst        (rst),
        .en         (at_loops),
        .en_pi      (at_pi),
        .mode       (agc_mode),
        .magnitude  (r_cordic_magnitude),
        .setpoint   (bank_amplitude_setpoint),
        .preset     (fix_drive ? bank_amplitude_fixed : 24'sd0),
        .r_error    (r_agc_error),
        .r_loop_prop(r_agc_loop_prop),
        .r_loop_acc (r_agc_loop_acc),
        .r_loop_y   (r_agc_loop_y),
        .o_amplitude(o_amplitude),
        .o_saturated(drive_saturated)
    );

    gyro_frequency_tracker #(
        .MASTER_HZ                (MASTER_HZ),
        .DDS_BITS                 (DDS_BITS),
        .ACCUMULATOR_FRACTION_BITS(ACCUMULATOR_FRACTION_BITS),
        .loop_kp                  (frequency_tracker_loop_kp),
        .loop_ki                  (frequency_tracker_loop_ki),
        .loop_lo                  (frequency_tracker_loop_lo),
        .loop_hi                  (frequency_tracker_loop_hi)
    ) frequency_tracker (
        .clk        (clk),
        .rst        (rst),
        .en         (at_loops),
        .en_pi      (at_pi),
        .mode       (pll_mode),
        .phase      (r_cordic_phase),
        .load       (load),
        .adjust     (adjust),
        .correction (r_sequencer_correction),
        .preset     (bank_frequency_fixed),
        .r_error    (r_frequency_tracker_error),
        .r_centre   (r_frequency_tracker_centre),
        .r_word     (r_frequency_tracker_word),
        .r_loop_prop(r_frequency_tracker_loop_prop),
        .r_loop_acc (r_frequency_tracker_loop_acc),
        .r_loop_y   (r_frequency_tracker_loop_y)
    );

    gyro_rate_loop #(
        .ACCUMULATOR_FRACTION_BITS(ACCUMULATOR_FRACTION_BITS),
        .loop_kp                  (rate_loop_loop_kp),
        .loop_ki                  (rate_loop_loop_ki),
        .loop_lo                  (rate_loop_loop_lo),
        .loop_hi                  (rate_loop_loop_hi)
    ) rate_loop (
        .clk        (clk),
        .rst        (rst),
        .en         (at_loops),
        .en_pi      (at_pi),
        .mode       (ftr_mode),
        .sense_sin  (sense_sin),
        .preset     (fix_ftr ? bank_rate_fixed : 24'sd0),
        .r_error    (r_rate_loop_error),
        .r_loop_prop(r_rate_loop_loop_prop),
        .r_loop_acc (r_rate_loop_loop_acc),
        .r_loop_y   (r_rate_loop_loop_y),
        .o_saturated(rate_saturated)
    );

    gyro_quadrature_loop #(
        .ACCUMULATOR_FRACTION_BITS(ACCUMULATOR_FRACTION_BITS),
        .loop_kp                  (quadrature_loop_loop_kp),
        .loop_ki                  (quadrature_loop_loop_ki),
        .loop_lo                  (quadrature_loop_loop_lo),
        .loop_hi                  (quadrature_loop_loop_hi)
    ) quadrature_loop (
        .clk             (clk),
        .rst             (rst),
        .en              (at_loops),
        .en_pi           (at_pi),
        .en_root         (at_root),
        .mode            (qsc_mode),
        .sense_cos       (sense_cos),
        .preset          (fix_qsc ? bank_quadrature_fixed : 32'd0),
        .r_error         (r_quadrature_loop_error),
        .r_loop_prop     (r_quadrature_loop_loop_prop),
        .r_loop_acc      (r_quadrature_loop_loop_acc),
        .r_loop_y        (r_quadrature_loop_loop_y),
        .r_root_radicand (r_quadrature_loop_root_radicand),
        .r_root_root     (r_quadrature_loop_root_root),
        .r_root_remainder(r_quadrature_loop_root_remainder),
        .r_root_i        (r_quadrature_loop_root_i),
        .r_root_busy     (r_quadrature_loop_root_busy),
        .r_root_done     (r_quadrature_loop_root_done),
        .r_root_y        (r_quadrature_loop_root_y),
        .o_railed        (qsc_rail)
    );

    gyro_rate_output rate_output (
        .clk        (clk),
        .rst        (rst),
        .bias       (bank_rate_bias),
        .bias_t1    (bank_rate_bias_t1),
        .bias_t2    (bank_rate_bias_t2),
        .scale      (bank_rate_scale),
        .scale_t1   (bank_rate_scale_t1),
        .scale_t2   (bank_rate_scale_t2),
        .decimation (bank_decimation),
        .en         (at_root),
        .word       (r_rate_loop_loop_y[23:0]),
        .temperature(temperature),
        .r_stage    (r_rate_output_stage),
        .r_word     (r_rate_output_word),
        .r_t        (r_rate_output_t),
        .r_t2       (r_rate_output_t2),
        .r_bias     (r_rate_output_bias),
        .r_scale    (r_rate_output_scale),
        .r_corrected(r_rate_output_corrected),
        .r_scaled   (r_rate_output_scaled),
        .r_acc      (r_rate_output_acc),
        .r_count    (r_rate_output_count),
        .r_k        (r_rate_output_k),
        .r_y        (r_rate_output_y),
        .r_valid    (r_rate_output_valid)
    );

endmodule
