// PI controller with a clamped integrator.
//   mode 0 OFF: prop = 0, acc = clamp(preset)   1 P_ONLY: prop = kp*e   2 RUN: prop and acc   3 HOLD; en = 0 holds too
//   every clock: y = clamp(round(prop + acc))
// Latency: 2 clocks from an enabled e to y.   Rounding: ties toward +inf, at y only.
// Overflow: acc and y saturate at lo and hi; prop, [1,35,24], holds every product.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_pi #(
    parameter signed [33:0] kp = 34'sd0,  // [1,9,24]
    parameter signed [33:0] ki = 34'sd0,  // [1,9,24]
    parameter signed [35:0] lo = 36'sd0,  // [1,35,0]
    parameter signed [35:0] hi = 36'sd0   // [1,35,0]
) (
    input  wire               clk,
    input  wire               rst,        // synchronous, active high
    input  wire               en,
    input  wire         [1:0] mode,
    input  wire signed [25:0] e,          // [1,25,0]
    input  wire signed [35:0] preset,     // [1,35,0]
    output reg  signed [59:0] r_prop,     // [1,35,24]
    output reg  signed [59:0] r_acc,      // [1,35,24]
    output reg  signed [35:0] r_y         // [1,35,0]
);

    localparam [1:0] OFF = 2'd0, P_ONLY = 2'd1, RUN = 2'd2;

    localparam signed [59:0] KP = {{26{kp[33]}}, kp};
    localparam signed [59:0] KI = {{26{ki[33]}}, ki};
    // limits of y, of acc, and each in the width it is compared in
    localparam signed [59:0] ACC_LO = {lo, 24'd0};
    localparam signed [59:0] ACC_HI = {hi, 24'd0};
    localparam signed [60:0] SUM_LO = {lo[35], ACC_LO};
    localparam signed [60:0] SUM_HI = {hi[35], ACC_HI};
    localparam signed [37:0] Y_LO = {{2{lo[35]}}, lo};
    localparam signed [37:0] Y_HI = {{2{hi[35]}}, hi};

    wire signed [59:0] wide_e = {{34{e[25]}}, e};
    wire signed [59:0] kp_e = KP * wide_e;
    wire signed [59:0] ki_e = KI * wide_e;
    wire signed [60:0] next_acc = {r_acc[59], r_acc} + {ki_e[59], ki_e};

    // prop + acc takes one bit more, the rounding constant another
    wire signed [61:0] sum = {{2{r_prop[59]}}, r_prop} + {{2{r_acc[59]}}, r_acc} + 62'sd8388608;
    wire signed [37:0] rounded = sum[61:24];
    /* verilator lint_off UNUSED */       // waived: what rounding drops
    wire [23:0] dropped = sum[23:0];
    /* verilator lint_on UNUSED */

    always @(posedge clk) begin
        if (rst) begin
            r_prop <= 60'sd0;
            r_acc  <= 60'sd0;
            r_y    <= 36'sd0;
        end else begin
            r_y <= (rounded < Y_LO) ? lo : (rounded > Y_HI) ? hi : rounded[35:0];
            if (en) begin
                if (mode == OFF)
                    r_prop <= 60'sd0;
                else if (mode == P_ONLY || mode == RUN)
                    r_prop <= kp_e;
                if (mode == OFF)
                    r_acc <= (preset < lo) ? ACC_LO : (preset > hi) ? ACC_HI : {preset, 24'd0};
                else if (mode == RUN)
                    r_acc <= (next_acc < SUM_LO) ? ACC_LO : (next_acc > SUM_HI) ? ACC_HI : next_acc[59:0];
            end
        end
    end

endmodule
