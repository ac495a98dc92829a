// Lock of the four loops: each error against two limits, debounced by one counter a loop.
//   pending = locked ? abs(error) > limit_out : abs(error) <= limit_in; so many frames of it in a row toggle locked
// Latency: 1 clock from en to locked.   Rounding: the products with the setpoint are cut.   No overflow.
// Loop 0 agc, 1 pll, 2 ftr, 3 qsc. Not enabled: not locked; enabled but not judged: bit and count are kept.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_lock_monitor #(
    parameter [23:0] limit_in_0   = 24'd0,   // [0,24,0] 2**-16 of the setpoint
    parameter [23:0] limit_in_1   = 24'd0,   // 2**-24 turn
    parameter [23:0] limit_in_2   = 24'd0,   // code LSB
    parameter [23:0] limit_in_3   = 24'd0,
    parameter [23:0] limit_out_0  = 24'd0,
    parameter [23:0] limit_out_1  = 24'd0,
    parameter [23:0] limit_out_2  = 24'd0,
    parameter [23:0] limit_out_3  = 24'd0,
    parameter [11:0] frames_in_0  = 12'd0,   // [0,12,0]
    parameter [11:0] frames_in_1  = 12'd0,
    parameter [11:0] frames_in_2  = 12'd0,
    parameter [11:0] frames_in_3  = 12'd0,
    parameter [11:0] frames_out_0 = 12'd0,
    parameter [11:0] frames_out_1 = 12'd0,
    parameter [11:0] frames_out_2 = 12'd0,
    parameter [11:0] frames_out_3 = 12'd0
) (
    input  wire               clk,
    input  wire               rst,           // synchronous, active high
    input  wire               en,
    input  wire         [3:0] enable,
    input  wire         [3:0] judged,
    input  wire signed [25:0] agc_error,     // [1,25,0]
    input  wire        [23:0] setpoint,      // [0,24,0]
    input  wire signed [23:0] phase,         // [1,-1,24] turn
    input  wire signed [23:0] sense_sin,     // [1,23,0]
    input  wire signed [23:0] sense_cos,     // [1,23,0]
    input  wire               rail,          // the quadrature loop is at its rail: no error counts
    output reg          [3:0] r_locked,
    output reg         [11:0] r_count_0,     // [0,12,0]
    output reg         [11:0] r_count_1,
    output reg         [11:0] r_count_2,
    output reg         [11:0] r_count_3
);

    // the most negative code has its magnitude in the same width, unsigned
    wire [25:0] agc = agc_error[25] ? -agc_error : agc_error;
    wire [23:0] pll = phase[23] ? -phase : phase;
    wire [23:0] ftr = sense_sin[23] ? -sense_sin : sense_sin;
    wire [23:0] qsc = sense_cos[23] ? -sense_cos : sense_cos;

    wire [47:0] scaled_in = {24'd0, setpoint} * {24'd0, limit_in_0};
    wire [47:0] scaled_out = {24'd0, setpoint} * {24'd0, limit_out_0};
    /* verilator lint_off UNUSED */          // waived: what the cut drops
    wire [31:0] dropped = {scaled_in[15:0], scaled_out[15:0]};
    /* verilator lint_on UNUSED */

    wire [3:0] good = {rail || (qsc <= limit_in_3), ftr <= limit_in_2, pll <= limit_in_1,
                       {6'd0, agc} <= scaled_in[47:16]};
    wire [3:0] lost = {!rail && (qsc > limit_out_3), ftr > limit_out_2, pll > limit_out_1,
                       {6'd0, agc} > scaled_out[47:16]};

    // {new lock bit, new count} of a loop
    function [12:0] judge;
        input        enabled;
        input        judged_too;
        input        is_locked;
        input [11:0] count;
        input        is_good;
        input        is_lost;
        input [11:0] frames_in;
        input [11:0] frames_out;
        reg          pending;
        reg   [12:0] more;
        begin
            pending = is_locked ? is_lost : is_good;
            more = {1'b0, count} + 13'd1;
            if (!enabled)
                judge = 13'd0;
            else if (!judged_too)
                judge = {is_locked, count};
            else if (!pending)
                judge = {is_locked, 12'd0};
            else if (more >= {1'b0, is_locked ? frames_out : frames_in})
                judge = {!is_locked, 12'd0};
            else
                judge = {is_locked, more[11:0]};
        end
    endfunction

    wire [12:0] next_0 = judge(enable[0], judged[0], r_locked[0], r_count_0, good[0], lost[0],
                                frames_in_0, frames_out_0);
    wire [12:0] next_1 = judge(enable[1], judged[1], r_locked[1], r_count_1, good[1], lost[1],
                                frames_in_1, frames_out_1);
    wire [12:0] next_2 = judge(enable[2], judged[2], r_locked[2], r_count_2, good[2], lost[2],
                                frames_in_2, frames_out_2);
    wire [12:0] next_3 = judge(enable[3], judged[3], r_locked[3], r_count_3, good[3], lost[3],
                                frames_in_3, frames_out_3);

    always @(posedge clk) begin
        if (rst) begin
            r_locked  <= 4'd0;
            r_count_0 <= 12'd0;
            r_count_1 <= 12'd0;
            r_count_2 <= 12'd0;
            r_count_3 <= 12'd0;
        end else if (en) begin
            r_locked  <= {next_3[12], next_2[12], next_1[12], next_0[12]};
            r_count_0 <= next_0[11:0];
            r_count_1 <= next_1[11:0];
            r_count_2 <= next_2[11:0];
            r_count_3 <= next_3[11:0];
        end
    end

endmodule
