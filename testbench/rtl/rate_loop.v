// Force-to-rebalance loop: a PI nulls the Coriolis component of y; its output word is the measured rate.
//   en: error = sense_sin;   en_pi: gyro_pi acts on error in its mode, OFF gives preset
// Latency: 3 clocks from en to r_loop_y when en_pi follows en by one clock.   Rounding: as gyro_pi.
// Overflow: r_loop_y saturates at loop_lo and loop_hi; o_saturated tells that it is at one of them.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_rate_loop #(
    parameter ACCUMULATOR_FRACTION_BITS = 24,  // of the PI
    parameter signed [33:0] loop_kp = 34'sd0,  // [1,9,24]
    parameter signed [33:0] loop_ki = 34'sd0,  // [1,9,24]
    parameter signed [35:0] loop_lo = 36'sd0,  // [1,35,0]
    parameter signed [35:0] loop_hi = 36'sd0   // [1,35,0]
) (
    input  wire                                         clk,
    input  wire                                         rst,          // synchronous, active high
    input  wire                                         en,
    input  wire                                         en_pi,
    input  wire                                   [1:0] mode,
    input  wire signed                           [23:0] sense_sin,    // [1,23,0]
    input  wire signed                           [23:0] preset,       // [1,0,23] of 10 V
    output reg  signed                           [23:0] r_error,      // [1,23,0]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_loop_prop,  // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_loop_acc,   // [1,35,24]
    output wire signed                           [35:0] r_loop_y,     // [1,35,0]
    output wire                                         o_saturated
);

    wire signed [25:0] loop_e = {{2{r_error[23]}}, r_error};
    wire signed [35:0] loop_preset = {{12{preset[23]}}, preset};

    gyro_pi #(
        .ACCUMULATOR_FRACTION_BITS(ACCUMULATOR_FRACTION_BITS),
        .kp(loop_kp), .ki(loop_ki), .lo(loop_lo), .hi(loop_hi)
    ) loop (
        .clk(clk), .rst(rst), .en(en_pi), .mode(mode), .e(loop_e), .preset(loop_preset),
        .r_prop(r_loop_prop), .r_acc(r_loop_acc), .r_y(r_loop_y)
    );

    assign o_saturated = (r_loop_y >= loop_hi) | (r_loop_y <= loop_lo);

    always @(posedge clk) begin
        if (rst)
            r_error <= 24'sd0;
        else if (en)
            r_error <= sense_sin;
    end

endmodule
