// Notch at the output of the rate loop: a second-order filter of the force word, before the rate output takes it.
//   en: y1 = clamp(round(g*(x + x2) + c*(x1 - y1) - (2*g - 1)*y2)), y2 = y1, x1 = x, x2 = x1;   out = round(y1)
// Latency: 1 clock from en to o_out.   Rounding: ties toward +inf in y1 and in o_out.
// Overflow: y1 saturates at the limits of the word, so that o_out cannot overflow.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_notch #(
    parameter signed [23:0] g = 24'sd0,  // [1,1,22]
    parameter signed [23:0] c = 24'sd0   // [1,1,22]
) (
    input  wire               clk,
    input  wire               rst,       // synchronous, active high
    input  wire               en,
    input  wire signed [23:0] x,         // [1,0,23] of 10 V
    output reg  signed [23:0] r_x1,      // [1,0,23]
    output reg  signed [23:0] r_x2,      // [1,0,23]
    output reg  signed [33:0] r_y1,      // [1,0,33]
    output reg  signed [33:0] r_y2,      // [1,0,33]
    output wire signed [23:0] o_out      // [1,0,23]
);

    localparam signed [36:0] Y_LO = -37'sd8589934592, Y_HI = 37'sd8589933568;

    /* verilator lint_off UNUSED */ // waived: low bits are rounded away
    // sums of two in one bit more; 2g - 1 has the format of g and c; 2097152 is half of what is dropped
    wire signed [24:0] ends = {x[23], x} + {r_x2[23], r_x2};
    wire signed [34:0] behind = {r_x1[23], r_x1, 10'd0} - {r_y1[33], r_y1};
    wire signed [23:0] damping = {g[22:0], 1'b0} - 24'sd4194304;
    wire signed [58:0] wide_g = {{35{g[23]}}, g};
    wire signed [58:0] wide_c = {{35{c[23]}}, c};
    wire signed [58:0] wide_d = {{35{damping[23]}}, damping};
    wire signed [58:0] wide_ends = {{24{ends[24]}}, ends, 10'd0};
    wire signed [58:0] wide_behind = {{24{behind[34]}}, behind};
    wire signed [58:0] wide_y2 = {{25{r_y2[33]}}, r_y2};
    wire signed [58:0] total = wide_g * wide_ends + wide_c * wide_behind - wide_d * wide_y2 + 59'sd2097152;
    wire signed [36:0] y = total[58:22];
    wire signed [36:0] clamped = (y < Y_LO) ? Y_LO : (y > Y_HI) ? Y_HI : y;
    wire signed [33:0] rounded = r_y1 + 34'sd512;
    /* verilator lint_on UNUSED */

    assign o_out = rounded[33:10];

    always @(posedge clk) begin
        if (rst) begin
            r_x1 <= 24'sd0;
            r_x2 <= 24'sd0;
            r_y1 <= 34'sd0;
            r_y2 <= 34'sd0;
        end else if (en) begin
            r_x1 <= x;
            r_x2 <= r_x1;
            r_y1 <= clamped[33:0];
            r_y2 <= r_y1;
        end
    end

endmodule
