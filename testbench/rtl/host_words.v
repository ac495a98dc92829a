// What a host reads: the word of each register of gyro_top, or of the port itself; 0 where no register is.
//   a register of the firmware is a port with the name of its register port of gyro_top, without r_
// Latency: none, no clock.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_host_words #(
    parameter DDS_BITS = 48
) (
    input  wire                 [7:0] address,  // of the register
    input  wire                 [8:0] registers_control,
    input  wire                 [7:0] control_sequencer_faults_latch,
    input  wire        [DDS_BITS-1:0] registers_phase_drive_sine,
    input  wire        [DDS_BITS-1:0] registers_phase_sense_sine,
    input  wire        [DDS_BITS-1:0] registers_phase_drive_ref,
    input  wire        [DDS_BITS-1:0] registers_phase_sense_ref,
    input  wire                [23:0] registers_amplitude_setpoint,
    input  wire        [DDS_BITS-1:0] registers_frequency_fixed,
    input  wire                [23:0] registers_amplitude_fixed,
    input  wire                [23:0] registers_rate_fixed,
    input  wire                [31:0] registers_quadrature_fixed,
    input  wire                [31:0] registers_rate_bias,
    input  wire                [31:0] registers_rate_bias_t1,
    input  wire                [31:0] registers_rate_bias_t2,
    input  wire                [29:0] registers_rate_scale,
    input  wire                [23:0] registers_rate_scale_t1,
    input  wire                [23:0] registers_rate_scale_t2,
    input  wire                 [2:0] registers_decimation,
    input  wire                 [3:0] control_sequencer_state,
    input  wire                 [3:0] control_sequencer_lock_locked,
    input  wire                 [7:0] control_sequencer_faults_flags,
    input  wire                 [7:0] control_sequencer_attempts,
    input  wire        [DDS_BITS-1:0] control_frequency_tracker_word,
    /* verilator lint_off UNUSED */ // waived: bits beyond the limits of the loop
    input  wire                [35:0] control_agc_loop_y,
    /* verilator lint_on UNUSED */
    input  wire                [24:0] control_cordic_magnitude,
    input  wire                [23:0] control_cordic_phase,
    /* verilator lint_off UNUSED */ // waived: bits beyond the limits of the loop
    input  wire                [35:0] control_rate_loop_loop_y,
    /* verilator lint_on UNUSED */
    input  wire                [15:0] control_quadrature_loop_root_y,
    input  wire                [31:0] control_rate_output_y,
    input  wire                [15:0] control_rate_output_t,
    input  wire                [31:0] bus_rate,               // registers of the port itself
    input  wire                [15:0] bus_held_temperature,
    input  wire                [20:0] bus_held_status,
    input  wire                [11:0] bus_held_number,
    input  wire                 [2:0] errors,
    output reg                 [47:0] value
);

    always @* begin
        value = 48'd0;
        case (address)
            8'h00: value[8:0] = registers_control;
            8'h01: value[7:0] = control_sequencer_faults_latch;
            8'h02: value[DDS_BITS-1:0] = registers_phase_drive_sine;
            8'h03: value[DDS_BITS-1:0] = registers_phase_sense_sine;
            8'h04: value[DDS_BITS-1:0] = registers_phase_drive_ref;
            8'h05: value[DDS_BITS-1:0] = registers_phase_sense_ref;
            8'h06: value[23:0] = registers_amplitude_setpoint;
            8'h07: value[DDS_BITS-1:0] = registers_frequency_fixed;
            8'h08: value[23:0] = registers_amplitude_fixed;
            8'h09: value[23:0] = registers_rate_fixed;
            8'h0A: value[31:0] = registers_quadrature_fixed;
            8'h0B: value[31:0] = registers_rate_bias;
            8'h0C: value[31:0] = registers_rate_bias_t1;
            8'h0D: value[31:0] = registers_rate_bias_t2;
            8'h0E: value[29:0] = registers_rate_scale;
            8'h0F: value[23:0] = registers_rate_scale_t1;
            8'h10: value[23:0] = registers_rate_scale_t2;
            8'h11: value[2:0] = registers_decimation;
            8'h40: value = 48'h4759524F0002;
            8'h41: value[3:0] = control_sequencer_state;
            8'h42: value[3:0] = control_sequencer_lock_locked;
            8'h43: value[7:0] = control_sequencer_faults_flags;
            8'h44: value[7:0] = control_sequencer_attempts;
            8'h45: value[DDS_BITS-1:0] = control_frequency_tracker_word;
            8'h46: value[23:0] = control_agc_loop_y[23:0];
            8'h47: value[24:0] = control_cordic_magnitude;
            8'h48: value[23:0] = control_cordic_phase;
            8'h49: value[23:0] = control_rate_loop_loop_y[23:0];
            8'h4A: value[15:0] = control_quadrature_loop_root_y;
            8'h4B: value[31:0] = control_rate_output_y;
            8'h4C: value[15:0] = control_rate_output_t;
            8'h50: value[31:0] = bus_rate;
            8'h51: value[15:0] = bus_held_temperature;
            8'h52: value[20:0] = bus_held_status;
            8'h53: value[11:0] = bus_held_number;
            8'h54: value[2:0] = errors;
            default: ;
        endcase
    end

endmodule
