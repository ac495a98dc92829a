// Port of the host beside gyro_top, whose registers it reads: SPI slave, bus, and the word of each register.
//   r_bus_bank_write, r_bus_bank_address, r_bus_bank_data    to write, address, data of gyro_top
//   a register of the firmware is a port with the name of its register port of gyro_top, without r_
// Latency: 2 clocks from the end of a frame on the SPI port's registers to write; a sample 1 clock behind the last
// slot.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_host #(
    parameter DDS_BITS = 48
) (
    input  wire                       clk,
    input  wire                       rst,   // synchronous, active high
    input  wire                       cs_n,  // pins of the host, asynchronous
    input  wire                       sck,
    input  wire                       sdi,
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
    input  wire                 [5:0] rates_slot,
    input  wire                       control_rate_output_valid,
    input  wire                 [2:0] control_rate_output_k,
    output wire                       r_slave_cs_meta,
    output wire                       r_slave_cs_n,
    output wire                       r_slave_active,
    output wire                       r_slave_sck_meta,
    output wire                       r_slave_sck,
    output wire                       r_slave_sck_seen,
    output wire                       r_slave_sdi_meta,
    output wire                       r_slave_sdi,
    output wire                 [2:0] r_slave_phase,
    output wire                 [4:0] r_slave_bit,
    output wire                 [2:0] r_slave_words,
    output wire                       r_slave_read,
    output wire                [10:0] r_slave_address,
    output wire                 [7:0] r_slave_crc,
    output wire                [39:0] r_slave_shift,
    output wire                [31:0] r_slave_data,
    output wire                       r_slave_second,
    output wire                       r_slave_spoiled,
    output wire                       r_slave_refused,
    output wire                       r_slave_write,
    output wire                       r_slave_done,
    output wire                 [2:0] r_slave_errors,
    output wire                [15:0] r_bus_high,
    output wire                 [7:0] r_bus_high_of,
    output wire                [31:0] r_bus_low,
    output wire                 [2:0] r_bus_low_of,
    output wire                       r_bus_pending,
    output wire                       r_bus_bank_write,
    output wire                 [7:0] r_bus_bank_address,
    output wire                [47:0] r_bus_bank_data,
    output wire                 [2:0] r_bus_clear,
    output wire                [11:0] r_bus_frames,
    output wire                       r_bus_fresh,
    output wire signed         [31:0] r_bus_rate,
    output wire signed         [15:0] r_bus_temperature,
    output wire                [18:0] r_bus_status,
    output wire                [11:0] r_bus_number,
    output wire signed         [15:0] r_bus_held_temperature,
    output wire                [20:0] r_bus_held_status,
    output wire                [11:0] r_bus_held_number,
    output wire                 [1:0] r_bus_unread,
    output wire                 [1:0] r_bus_unread_after,
    output wire                       r_bus_reading,
    output wire                       o_sdo,
    output wire                       o_data_ready
);

    localparam [5:0] SLOTS = 6'd60;

    wire fetch, start;
    wire [31:0] rdata;
    wire [4:0] bus_status;

    // what the host reads: the word of the register at the slave's address
    reg [47:0] value;
    always @* begin
        value = 48'd0;
        case (r_slave_address[10:3])
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
            8'h40: value = 48'h4759524F0001;
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
            8'h50: value[31:0] = r_bus_rate;
            8'h51: value[15:0] = r_bus_held_temperature;
            8'h52: value[20:0] = r_bus_held_status;
            8'h53: value[11:0] = r_bus_held_number;
            8'h54: value[2:0] = r_slave_errors;
            default: ;
        endcase
    end

    gyro_spi_slave slave (
        .clk       (clk),
        .rst       (rst),
        .cs_n      (cs_n),
        .sck       (sck),
        .sdi       (sdi),
        .status    (bus_status),
        .rdata     (rdata),
        .clear     (r_bus_clear),
        .r_cs_meta (r_slave_cs_meta),
        .r_cs_n    (r_slave_cs_n),
        .r_active  (r_slave_active),
        .r_sck_meta(r_slave_sck_meta),
        .r_sck     (r_slave_sck),
        .r_sck_seen(r_slave_sck_seen),
        .r_sdi_meta(r_slave_sdi_meta),
        .r_sdi     (r_slave_sdi),
        .r_phase   (r_slave_phase),
        .r_bit     (r_slave_bit),
        .r_words   (r_slave_words),
        .r_read    (r_slave_read),
        .r_address (r_slave_address),
        .r_crc     (r_slave_crc),
        .r_shift   (r_slave_shift),
        .r_data    (r_slave_data),
        .r_second  (r_slave_second),
        .r_spoiled (r_slave_spoiled),
        .r_refused (r_slave_refused),
        .r_write   (r_slave_write),
        .r_done    (r_slave_done),
        .r_errors  (r_slave_errors),
        .o_sdo     (o_sdo),
        .o_fetch   (fetch),
        .o_start   (start)
    );

    gyro_host_bus #(
        .pairs(DDS_BITS > 32 ? 8'hBC : 8'h00)
    ) bus (
        .clk               (clk),
        .rst               (rst),
        .address           (r_slave_address),
        .fetch             (fetch),
        .start             (start),
        .done              (r_slave_done),
        .write             (r_slave_write),
        .data              (r_slave_data),
        .value             (value),
        .frame             (rates_slot == SLOTS),
        .valid             (control_rate_output_valid),
        .rate              (control_rate_output_y),
        .temperature       (control_rate_output_t),
        .k                 (control_rate_output_k),
        .flags             (control_sequencer_faults_flags),
        .state             (control_sequencer_state),
        .lock              (control_sequencer_lock_locked),
        .r_high            (r_bus_high),
        .r_high_of         (r_bus_high_of),
        .r_low             (r_bus_low),
        .r_low_of          (r_bus_low_of),
        .r_pending         (r_bus_pending),
        .r_bank_write      (r_bus_bank_write),
        .r_bank_address    (r_bus_bank_address),
        .r_bank_data       (r_bus_bank_data),
        .r_clear           (r_bus_clear),
        .r_frames          (r_bus_frames),
        .r_fresh           (r_bus_fresh),
        .r_rate            (r_bus_rate),
        .r_temperature     (r_bus_temperature),
        .r_status          (r_bus_status),
        .r_number          (r_bus_number),
        .r_held_temperature(r_bus_held_temperature),
        .r_held_status     (r_bus_held_status),
        .r_held_number     (r_bus_held_number),
        .r_unread          (r_bus_unread),
        .r_unread_after    (r_bus_unread_after),
        .r_reading         (r_bus_reading),
        .o_rdata           (rdata),
        .o_bus_status      (bus_status),
        .o_data_ready      (o_data_ready)
    );

endmodule
