// Port of the host beside gyro_top, whose registers it reads: AXI4-Lite slave, bus, and the words of the registers.
//   r_bus_bank_write, r_bus_bank_address, r_bus_bank_data    to write, address, data of gyro_top
//   a register of the firmware is a port with the name of its register port of gyro_top, without r_
// Latency: a register of gyro_top has a word 3 clocks behind the edge that takes its write; a sample 1 clock behind the
// last slot.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_host_axi #(
    parameter DDS_BITS = 48
) (
    input  wire                       clk,
    input  wire                       rst,   // synchronous, active high: !ARESETn
    input  wire                       awvalid,
    input  wire                [10:0] awaddr,
    input  wire                       wvalid,
    input  wire                [31:0] wdata,
    input  wire                 [3:0] wstrb,
    input  wire                       bready,
    input  wire                       arvalid,
    input  wire                [10:0] araddr,
    input  wire                       rready,
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
    input  wire                [35:0] control_agc_loop_y,
    input  wire                [24:0] control_cordic_magnitude,
    input  wire                [23:0] control_cordic_phase,
    input  wire                [35:0] control_rate_loop_loop_y,
    input  wire                [15:0] control_quadrature_loop_root_y,
    input  wire                [31:0] control_rate_output_y,
    input  wire                [15:0] control_rate_output_t,
    input  wire                 [5:0] rates_slot,
    input  wire                       control_rate_output_valid,
    input  wire                 [2:0] control_rate_output_k,
    output wire                       r_slave_awready,
    output wire                [10:0] r_slave_awaddr,
    output wire                       r_slave_wready,
    output wire                [31:0] r_slave_wdata,
    output wire                 [3:0] r_slave_wstrb,
    output wire                       r_slave_bvalid,
    output wire                 [1:0] r_slave_bresp,
    output wire                       r_slave_arready,
    output wire                [10:0] r_slave_araddr,
    output wire                       r_slave_rvalid,
    output wire                [31:0] r_slave_rdata,
    output wire                 [1:0] r_slave_rresp,
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
    output wire                       o_awready,
    output wire                       o_wready,
    output wire                       o_bvalid,
    output wire                 [1:0] o_bresp,
    output wire                       o_arready,
    output wire                       o_rvalid,
    output wire                [31:0] o_rdata,
    output wire                 [1:0] o_rresp,
    output wire                       o_data_ready
);

    localparam [5:0] SLOTS = 6'd60;

    wire fetch, write, done;
    wire [10:0] address;
    wire [31:0] rdata;
    /* verilator lint_off UNUSED */ // waived: the status of a frame of SPI; bits 1 .. 0 of an address are the slave's
    wire [4:0] bus_status;
    /* verilator lint_on UNUSED */

    assign o_awready = r_slave_awready;
    assign o_wready  = r_slave_wready;
    assign o_bvalid  = r_slave_bvalid;
    assign o_bresp   = r_slave_bresp;
    assign o_arready = r_slave_arready;
    assign o_rvalid  = r_slave_rvalid;
    assign o_rdata   = r_slave_rdata;
    assign o_rresp   = r_slave_rresp;

    // what the host reads: the word of the register at the slave's address; this port has no frames to be wrong
    wire [47:0] value;
    gyro_host_words #(
        .DDS_BITS(DDS_BITS)
    ) words (
        .address                       (address[10:3]),
        .registers_control             (registers_control),
        .control_sequencer_faults_latch(control_sequencer_faults_latch),
        .registers_phase_drive_sine    (registers_phase_drive_sine),
        .registers_phase_sense_sine    (registers_phase_sense_sine),
        .registers_phase_drive_ref     (registers_phase_drive_ref),
        .registers_phase_sense_ref     (registers_phase_sense_ref),
        .registers_amplitude_setpoint  (registers_amplitude_setpoint),
        .registers_frequency_fixed     (registers_frequency_fixed),
        .registers_amplitude_fixed     (registers_amplitude_fixed),
        .registers_rate_fixed          (registers_rate_fixed),
        .registers_quadrature_fixed    (registers_quadrature_fixed),
        .registers_rate_bias           (registers_rate_bias),
        .registers_rate_bias_t1        (registers_rate_bias_t1),
        .registers_rate_bias_t2        (registers_rate_bias_t2),
        .registers_rate_scale          (registers_rate_scale),
        .registers_rate_scale_t1       (registers_rate_scale_t1),
        .registers_rate_scale_t2       (registers_rate_scale_t2),
        .registers_decimation          (registers_decimation),
        .control_sequencer_state       (control_sequencer_state),
        .control_sequencer_lock_locked (control_sequencer_lock_locked),
        .control_sequencer_faults_flags(control_sequencer_faults_flags),
        .control_sequencer_attempts    (control_sequencer_attempts),
        .control_frequency_tracker_word(control_frequency_tracker_word),
        .control_agc_loop_y            (control_agc_loop_y),
        .control_cordic_magnitude      (control_cordic_magnitude),
        .control_cordic_phase          (control_cordic_phase),
        .control_rate_loop_loop_y      (control_rate_loop_loop_y),
        .control_quadrature_loop_root_y(control_quadrature_loop_root_y),
        .control_rate_output_y         (control_rate_output_y),
        .control_rate_output_t         (control_rate_output_t),
        .bus_rate                      (r_bus_rate),
        .bus_held_temperature          (r_bus_held_temperature),
        .bus_held_status               (r_bus_held_status),
        .bus_held_number               (r_bus_held_number),
        .errors                        (3'd0),
        .value                         (value)
    );

    gyro_axi_slave slave (
        .clk      (clk),
        .rst      (rst),
        .awvalid  (awvalid),
        .awaddr   (awaddr),
        .wvalid   (wvalid),
        .wdata    (wdata),
        .wstrb    (wstrb),
        .bready   (bready),
        .arvalid  (arvalid),
        .araddr   (araddr),
        .rready   (rready),
        .word     (rdata),
        .r_awready(r_slave_awready),
        .r_awaddr (r_slave_awaddr),
        .r_wready (r_slave_wready),
        .r_wdata  (r_slave_wdata),
        .r_wstrb  (r_slave_wstrb),
        .r_bvalid (r_slave_bvalid),
        .r_bresp  (r_slave_bresp),
        .r_arready(r_slave_arready),
        .r_araddr (r_slave_araddr),
        .r_rvalid (r_slave_rvalid),
        .r_rdata  (r_slave_rdata),
        .r_rresp  (r_slave_rresp),
        .o_address(address),
        .o_write  (write),
        .o_fetch  (fetch),
        .o_done   (done)
    );

    gyro_host_bus #(
        .pairs(DDS_BITS > 32 ? 8'hBC : 8'h00)
    ) bus (
        .clk               (clk),
        .rst               (rst),
        .address           (address),
        .fetch             (fetch),
        .start             (1'b0),
        .done              (done),
        .write             (write),
        .data              (r_slave_wdata),
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
