// Drive amplitude loop: a PI on setpoint - magnitude, and the fixed kick of the start-up.
//   mode 0 to 3 as gyro_pi;   4 KICK: amplitude = kick, the PI is OFF with preset 0;   5 to 7 hold
// Latency: 3 clocks from en to r_loop_y when en_pi follows en by one clock.   Rounding: as gyro_pi.
// Overflow: error cannot; r_loop_y saturates at loop_lo and loop_hi, which must lie in 0 .. 2**23 - 1.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_agc #(
    parameter ACCUMULATOR_FRACTION_BITS = 24,  // of the PI
    parameter signed [33:0] loop_kp = 34'sd0,  // [1,9,24]
    parameter signed [33:0] loop_ki = 34'sd0,  // [1,9,24]
    parameter signed [35:0] loop_lo = 36'sd0,  // [1,35,0]
    parameter signed [35:0] loop_hi = 36'sd0,  // [1,35,0]
    parameter signed [23:0] kick    = 24'sd0   // [1,0,23] of 10 V
) (
    input  wire                                         clk,
    input  wire                                         rst,          // synchronous, active high
    input  wire                                         en,
    input  wire                                         en_pi,
    input  wire                                   [2:0] mode,
    input  wire                                  [24:0] magnitude,    // [0,25,0]
    input  wire                                  [23:0] setpoint,     // [0,24,0]
    input  wire signed                           [23:0] preset,       // [1,0,23] of 10 V
    output reg  signed                           [25:0] r_error,      // [1,25,0]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_loop_prop,  // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_loop_acc,   // [1,35,24]
    output wire signed                           [35:0] r_loop_y,     // [1,35,0]
    output wire signed                           [23:0] o_amplitude,  // [1,0,23] of 10 V
    output wire                                         o_saturated
);

    localparam [2:0] KICK = 3'd4;
    localparam [1:0] OFF = 2'd0, HOLD = 2'd3;

    wire kicked = (mode == KICK);
    wire [1:0] loop_mode = kicked ? OFF : mode[2] ? HOLD : mode[1:0];
    wire signed [35:0] loop_preset = kicked ? 36'sd0 : {{12{preset[23]}}, preset};

    gyro_pi #(
        .ACCUMULATOR_FRACTION_BITS(ACCUMULATOR_FRACTION_BITS),
        .kp(loop_kp), .ki(loop_ki), .lo(loop_lo), .hi(loop_hi)
    ) loop (
        .clk(clk), .rst(rst), .en(en_pi), .mode(loop_mode), .e(r_error), .preset(loop_preset),
        .r_prop(r_loop_prop), .r_acc(r_loop_acc), .r_y(r_loop_y)
    );

    assign o_amplitude = kicked ? kick : r_loop_y[23:0];
    assign o_saturated = (r_loop_y >= loop_hi);

    always @(posedge clk) begin
        if (rst)
            r_error <= 26'sd0;
        else if (en)
            r_error <= {2'b00, setpoint} - {1'b0, magnitude};
    end

endmodule
