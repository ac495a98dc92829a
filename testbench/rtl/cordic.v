// Vectoring CORDIC: magnitude = K*sqrt(x_in**2 + y_in**2), K = 1.646760258, and phase = atan2(y_in, x_in) in turns.
//   load: x = abs(x_in), y = +-y_in, angle = 0 or half a turn;   24 times: x, y, angle turned by d*atan(2**-i)
// Latency: 26 clocks from start to done = 1; the results stay. A start while busy begins anew.
// Rounding: ties toward +inf at every shift and at both results; 8 guard bits.
// Overflow: x, y and magnitude cannot; angle and phase wrap at one turn. Phase of the zero vector is 0.
// ROM_FILE: 24 hex words of 32 bits, atan(2**-i) in turns; no default that could hide a missing table.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_cordic #(
    parameter ROM_FILE = ""
) (
    input  wire               clk,
    input  wire               rst,          // synchronous, active high
    input  wire               start,
    input  wire signed [23:0] x_in,         // [1,23,0]
    input  wire signed [23:0] y_in,         // [1,23,0]
    output reg         [32:0] r_x,          // [0,25,8]
    output reg  signed [32:0] r_y,          // [1,24,8]
    output reg  signed [31:0] r_angle,      // [1,-1,32] turns
    output reg          [4:0] r_i,
    output reg                r_busy,
    output reg                r_done,
    output reg         [24:0] r_magnitude,  // [0,25,0]
    output reg  signed [23:0] r_phase       // [1,-1,24] turns
);

    localparam [4:0] ITERATIONS = 5'd24;
    localparam signed [31:0] HALF_TURN = {1'b1, 31'd0};

    reg [31:0] rom [0:23];
    initial $readmemh(ROM_FILE, rom);
    wire signed [31:0] atan = rom[r_i];

    // the opposites take one bit more: minus full scale has none in 24
    wire signed [24:0] wide_x = {x_in[23], x_in};
    wire signed [24:0] wide_y = {y_in[23], y_in};
    wire signed [24:0] turned_x = x_in[23] ? -wide_x : wide_x;
    wire signed [24:0] turned_y = x_in[23] ? -wide_y : wide_y;

    // x and y in one signed format, with a guard bit for the rounding constant 2**(i - 1), which is 0 for i = 0
    wire signed [34:0] x = {2'b00, r_x};
    wire signed [34:0] y = {{2{r_y[32]}}, r_y};
    wire signed [34:0] half = (35'sd1 <<< r_i) >>> 1;
    wire signed [34:0] across = (y + half) >>> r_i;
    wire signed [34:0] down = (x + half) >>> r_i;
    /* verilator lint_off UNUSED */         // waived: the guard bits, which repeat what stands below them
    wire signed [34:0] next_x = r_y[32] ? x - across : x + across;
    wire signed [34:0] next_y = r_y[32] ? y + down : y - down;
    /* verilator lint_on UNUSED */

    /* verilator lint_off UNUSED */         // waived: what rounding drops
    wire [32:0] magnitude = r_x + 33'd128;
    wire [31:0] phase = r_angle + 32'sd128;
    /* verilator lint_on UNUSED */

    always @(posedge clk) begin
        if (rst) begin
            r_x         <= 33'd0;
            r_y         <= 33'sd0;
            r_angle     <= 32'sd0;
            r_i         <= 5'd0;
            r_busy      <= 1'b0;
            r_done      <= 1'b0;
            r_magnitude <= 25'd0;
            r_phase     <= 24'sd0;
        end else if (start) begin
            r_x     <= {turned_x, 8'd0};
            r_y     <= {turned_y, 8'd0};
            r_angle <= x_in[23] ? HALF_TURN : 32'sd0;
            r_i     <= 5'd0;
            r_busy  <= 1'b1;
            r_done  <= 1'b0;
        end else if (!r_busy) begin
            r_done <= 1'b0;
        end else if (r_i < ITERATIONS) begin
            r_x     <= next_x[32:0];
            r_y     <= next_y[32:0];
            r_angle <= r_y[32] ? r_angle - atan : r_angle + atan;
            r_i     <= r_i + 5'd1;
        end else begin
            r_busy      <= 1'b0;
            r_done      <= 1'b1;
            r_magnitude <= magnitude[32:8];
            r_phase     <= (r_x == 33'd0) ? 24'sd0 : phase[31:8];
        end
    end

endmodule
