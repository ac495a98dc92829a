// Bank of gyro_registers: a write reaches the register of its address alone, and no one that clears a fault is lost.
//   bank, given   48 bits for each register, the first in the low bits: what they hold, and what the last word is to them
module prove_registers (
    input wire clk,
    input wire rst,
    input wire write,
    input wire [7:0] address,
    input wire [47:0] data,
    input wire taken,
    input wire [8:0] r_control,
    input wire [7:0] r_fault_clear,
    input wire [47:0] r_phase_drive_sine,
    input wire [47:0] r_phase_sense_sine,
    input wire [47:0] r_phase_drive_ref,
    input wire [47:0] r_phase_sense_ref,
    input wire [23:0] r_amplitude_setpoint,
    input wire [47:0] r_frequency_fixed,
    input wire signed [23:0] r_amplitude_fixed,
    input wire signed [23:0] r_rate_fixed,
    input wire [31:0] r_quadrature_fixed,
    input wire signed [31:0] r_rate_bias,
    input wire signed [31:0] r_rate_bias_t1,
    input wire signed [31:0] r_rate_bias_t2,
    input wire signed [29:0] r_rate_scale,
    input wire signed [23:0] r_rate_scale_t1,
    input wire signed [23:0] r_rate_scale_t2,
    input wire [2:0] r_decimation
);

    localparam COUNT = 18, WORD = 48, CLEAR = 1;

    wire [COUNT*WORD-1:0] bank = {
        45'd0, r_decimation, 24'd0, r_rate_scale_t2, 24'd0, r_rate_scale_t1,
        18'd0, r_rate_scale, 16'd0, r_rate_bias_t2, 16'd0, r_rate_bias_t1,
        16'd0, r_rate_bias, 16'd0, r_quadrature_fixed, 24'd0, r_rate_fixed,
        24'd0, r_amplitude_fixed, r_frequency_fixed, 24'd0, r_amplitude_setpoint,
        r_phase_sense_ref, r_phase_drive_ref, r_phase_sense_sine,
        r_phase_drive_sine, 40'd0, r_fault_clear, 39'd0, r_control
    };
    reg begun = 1'b0;
    reg was_rst, was_write, was_taken;
    reg [7:0] was_address, was_clear;
    reg [47:0] was_data;
    reg [COUNT*WORD-1:0] was_bank;
    always @(posedge clk) begin
        begun       <= 1'b1;
        was_rst     <= rst;
        was_write   <= write;
        was_taken   <= taken;
        was_address <= address;
        was_data    <= data;
        was_clear   <= r_fault_clear;
        was_bank    <= bank;
    end

    wire [COUNT*WORD-1:0] given = {
        45'd0, was_data[2:0], 24'd0, was_data[23:0], 24'd0, was_data[23:0],
        18'd0, was_data[29:0], 16'd0, was_data[31:0], 16'd0, was_data[31:0],
        16'd0, was_data[31:0], 16'd0, was_data[31:0], 24'd0, was_data[23:0],
        24'd0, was_data[23:0], was_data, 24'd0, was_data[23:0],
        was_data, was_data, was_data,
        was_data, 40'd0, was_data[7:0], 39'd0, was_data[8:0]
    };
    wire to_clear = was_write && was_address == CLEAR;
    wire [7:0] arrived = to_clear ? was_data[7:0] : 8'd0;
    wire [7:0] waiting = was_taken ? 8'd0 : was_clear;
    reg [COUNT-1:0] moved, right, named;
    integer k;
    always @* for (k = 0; k < COUNT; k = k + 1) begin
        moved[k] = bank[WORD*k +: WORD] != was_bank[WORD*k +: WORD] && k != CLEAR;
        right[k] = bank[WORD*k +: WORD] == given[WORD*k +: WORD] || k == CLEAR;
        named[k] = was_write && was_address == k;
    end

    always @* begin
        if (!begun)
            assume (rst);
        else if (was_rst)
            resets: assert (r_control == 9'h1 && r_amplitude_setpoint == 24'h97C3F3 && r_frequency_fixed == 48'h1BBA0D8C5E
                && r_rate_scale == 30'h793569E && r_decimation == 3'h3 && {r_fault_clear, r_phase_drive_sine,
                r_phase_sense_sine, r_phase_drive_ref, r_phase_sense_ref, r_amplitude_fixed, r_rate_fixed,
                r_quadrature_fixed, r_rate_bias, r_rate_bias_t1, r_rate_bias_t2, r_rate_scale_t1, r_rate_scale_t2} == 0);
        else begin
            word_arrives: assert ((named & ~right) == 0);
            others_rest: assert ((moved & ~named) == 0);
            // the ones of FAULT_CLEAR
            ones_are_held: assert ((waiting & ~r_fault_clear) == 0);
            ones_arrive: assert ((arrived & ~r_fault_clear) == 0);
            taken_empties: assert (!was_taken || to_clear || r_fault_clear == 0);
            no_one_by_itself: assert ((r_fault_clear & ~(waiting | arrived)) == 0);
        end
    end

endmodule
