// PI controller with a clamped integrator.
//   mode 0 OFF: prop = 0, acc = clamp(preset)   1 P_ONLY: prop = kp*e   2 RUN: prop and acc   3 HOLD; en = 0 holds too
//   both products are rounded to ACCUMULATOR_FRACTION_BITS
//   every clock: y = clamp(round(prop + acc))
// Latency: 2 clocks from an enabled e to y.   Rounding: ties toward +inf, at both products and y.
// Overflow: acc and y saturate at lo and hi; prop holds every product.   Formats are those of the default design.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_pi #(
    parameter ACCUMULATOR_FRACTION_BITS = 24,  // of prop and acc, 1 .. 24
    parameter signed [33:0] kp = 34'sd0,  // [1,9,24]
    parameter signed [33:0] ki = 34'sd0,  // [1,9,24]
    parameter signed [35:0] lo = 36'sd0,  // [1,35,0]
    parameter signed [35:0] hi = 36'sd0   // [1,35,0]
) (
    input  wire                                         clk,
    input  wire                                         rst,     // synchronous, active high
    input  wire                                         en,
    input  wire                                   [1:0] mode,
    input  wire signed                           [25:0] e,       // [1,25,0]
    input  wire signed                           [35:0] preset,  // [1,35,0]
    output reg  signed [ACCUMULATOR_FRACTION_BITS+35:0] r_prop,  // [1,35,24]
    output reg  signed [ACCUMULATOR_FRACTION_BITS+35:0] r_acc,   // [1,35,24]
    output reg  signed                           [35:0] r_y      // [1,35,0]
);

    localparam [1:0] OFF = 2'd0, P_ONLY = 2'd1, RUN = 2'd2;

    localparam F = ACCUMULATOR_FRACTION_BITS;
    localparam A = F + 36;
    localparam DROPPED = 24 - F;
    localparam signed [59:0] HALF_PRODUCT = (60'sd1 <<< DROPPED) >>> 1;
    localparam signed [A+1:0] HALF_Y = {{A+1{1'b0}}, 1'b1} << (F - 1);

    localparam signed [59:0] KP = {{26{kp[33]}}, kp};
    localparam signed [59:0] KI = {{26{ki[33]}}, ki};
    // limits of y, of acc, and each in the width it is compared in
    localparam signed [A-1:0] ACC_LO = {lo, {F{1'b0}}};
    localparam signed [A-1:0] ACC_HI = {hi, {F{1'b0}}};
    localparam signed [A:0] SUM_LO = {lo[35], ACC_LO};
    localparam signed [A:0] SUM_HI = {hi[35], ACC_HI};
    localparam signed [37:0] Y_LO = {{2{lo[35]}}, lo};
    localparam signed [37:0] Y_HI = {{2{hi[35]}}, hi};

    wire signed [59:0] wide_e = {{34{e[25]}}, e};
    /* verilator lint_off UNUSED */       // waived: copies of the sign where a narrow accumulator takes the low bits
    wire signed [59:0] wide_kp_e = (KP * wide_e + HALF_PRODUCT) >>> DROPPED;
    wire signed [59:0] wide_ki_e = (KI * wide_e + HALF_PRODUCT) >>> DROPPED;
    /* verilator lint_on UNUSED */
    wire signed [A-1:0] kp_e = wide_kp_e[A-1:0];
    wire signed [A-1:0] ki_e = wide_ki_e[A-1:0];
    wire signed [A:0] next_acc = {r_acc[A-1], r_acc} + {ki_e[A-1], ki_e};

    // prop + acc takes one bit more, the rounding constant another
    wire signed [A+1:0] sum = {{2{r_prop[A-1]}}, r_prop} + {{2{r_acc[A-1]}}, r_acc} + HALF_Y;
    wire signed [37:0] rounded = sum[A+1:F];
    /* verilator lint_off UNUSED */       // waived: what rounding drops
    wire [F-1:0] dropped = sum[F-1:0];
    /* verilator lint_on UNUSED */

    always @(posedge clk) begin
        if (rst) begin
            r_prop <= {A{1'b0}};
            r_acc  <= {A{1'b0}};
            r_y    <= 36'sd0;
        end else begin
            r_y <= (rounded < Y_LO) ? lo : (rounded > Y_HI) ? hi : rounded[35:0];
            if (en) begin
                if (mode == OFF)
                    r_prop <= {A{1'b0}};
                else if (mode == P_ONLY || mode == RUN)
                    r_prop <= kp_e;
                if (mode == OFF)
                    r_acc <= (preset < lo) ? ACC_LO : (preset > hi) ? ACC_HI : {preset, {F{1'b0}}};
                else if (mode == RUN)
                    r_acc <= (next_acc < SUM_LO) ? ACC_LO : (next_acc > SUM_HI) ? ACC_HI : next_acc[A-1:0];
            end
        end
    end

endmodule
