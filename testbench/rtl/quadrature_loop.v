// Quadrature loop: an integrator on u = V_q**2, whose root is the code of the voltage.
//   en: error = -sense_cos;   en_pi: gyro_pi acts on error, OFF gives preset;   en_root: r_root_y = floor(sqrt(u))
// Latency: 3 clocks from en to u = r_loop_y when en_pi follows en by one clock; 17 from en_root to r_root_y.
// Rounding: as gyro_pi; the root is cut.
// Overflow: u saturates at loop_lo and loop_hi, which must lie in 0 .. 2**32 - 1; error cannot.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_quadrature_loop #(
    parameter ACCUMULATOR_FRACTION_BITS = 24,  // of the PI
    parameter signed [33:0] loop_kp = 34'sd0,  // [1,9,24]
    parameter signed [33:0] loop_ki = 34'sd0,  // [1,9,24]
    parameter signed [35:0] loop_lo = 36'sd0,  // [1,35,0]
    parameter signed [35:0] loop_hi = 36'sd0   // [1,35,0]
) (
    input  wire                                         clk,
    input  wire                                         rst,               // synchronous, active high
    input  wire                                         en,
    input  wire                                         en_pi,
    input  wire                                         en_root,
    input  wire                                   [1:0] mode,
    input  wire signed                           [23:0] sense_cos,         // [1,23,0]
    input  wire                                  [31:0] preset,            // [0,32,0] of (5.5 V)**2
    output reg  signed                           [24:0] r_error,           // [1,24,0]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_loop_prop,       // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_loop_acc,        // [1,35,24]
    output wire signed                           [35:0] r_loop_y,          // [1,35,0]
    output wire                                  [31:0] r_root_radicand,   // [0,32,0]
    output wire                                  [15:0] r_root_root,       // [0,16,0]
    output wire                                  [16:0] r_root_remainder,  // [0,17,0]
    output wire                                   [3:0] r_root_i,
    output wire                                         r_root_busy,
    output wire                                         r_root_done,
    output wire                                  [15:0] r_root_y,          // [0,16,0] of 5.5 V
    output wire                                         o_railed
);

    wire signed [25:0] loop_e = {r_error[24], r_error};
    wire signed [35:0] loop_preset = {4'd0, preset};
    // minus full scale has no opposite in 24 bits
    wire signed [24:0] wide_cos = {sense_cos[23], sense_cos};

    gyro_pi #(
        .ACCUMULATOR_FRACTION_BITS(ACCUMULATOR_FRACTION_BITS),
        .kp(loop_kp), .ki(loop_ki), .lo(loop_lo), .hi(loop_hi)
    ) loop (
        .clk(clk), .rst(rst), .en(en_pi), .mode(mode), .e(loop_e), .preset(loop_preset),
        .r_prop(r_loop_prop), .r_acc(r_loop_acc), .r_y(r_loop_y)
    );

    gyro_isqrt root (
        .clk(clk), .rst(rst), .start(en_root), .u(r_loop_y[31:0]),
        .r_radicand(r_root_radicand), .r_root(r_root_root), .r_remainder(r_root_remainder),
        .r_i(r_root_i), .r_busy(r_root_busy), .r_done(r_root_done), .r_y(r_root_y)
    );

    assign o_railed = (r_loop_y <= loop_lo) | (r_loop_y >= loop_hi);

    always @(posedge clk) begin
        if (rst)
            r_error <= 25'sd0;
        else if (en)
            r_error <= -wide_cos;
    end

endmodule
