// Vectoring CORDIC: magnitude = K*sqrt(x_in**2 + y_in**2), K = 1.646760258 of 24; phase = atan2(y_in, x_in) in turns.
//   load: x = abs(x_in), y = +-y_in, angle = 0 or half a turn;   CORDIC_ITERATIONS times: x, y, angle turned by
//   d*atan(2**-i), then they hold up to 24 times in all
// Latency: 26 clocks from start to done = 1; the results stay. A start while busy begins anew.
// Rounding: ties toward +inf at every shift and at both results; CORDIC_GUARD_BITS guard bits.
// Overflow: x, y and magnitude cannot; angle and phase wrap at one turn. Phase of the zero vector is 0.
// ROM_FILE: 24 hex words of CORDIC_GUARD_BITS + 24 bits, atan(2**-i) in turns, 0 from CORDIC_ITERATIONS on; no default
// that could hide a missing table.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_cordic #(
    parameter CORDIC_ITERATIONS = 24,  // rotations, 1 .. 24
    parameter CORDIC_GUARD_BITS = 8,   // of x and y below an LSB of the input, of the angle below an LSB of phase
    parameter ROM_FILE = ""
) (
    input  wire                                 clk,
    input  wire                                 rst,          // synchronous, active high
    input  wire                                 start,
    input  wire signed                   [23:0] x_in,         // [1,23,0]
    input  wire signed                   [23:0] y_in,         // [1,23,0]
    output reg         [CORDIC_GUARD_BITS+24:0] r_x,          // [0,25,8]
    output reg  signed [CORDIC_GUARD_BITS+24:0] r_y,          // [1,24,8]
    output reg  signed [CORDIC_GUARD_BITS+23:0] r_angle,      // [1,-1,32] turns
    output reg                            [4:0] r_i,
    output reg                                  r_busy,
    output reg                                  r_done,
    output reg                           [24:0] r_magnitude,  // [0,25,0]
    output reg  signed                   [23:0] r_phase       // [1,-1,24] turns
);

    localparam [4:0] CLOCKS = 5'd24;
    localparam [4:0] ITERATIONS = CORDIC_ITERATIONS[4:0];
    localparam G = CORDIC_GUARD_BITS;
    localparam W = G + 25;
    localparam A = G + 24;
    localparam signed [A-1:0] HALF_TURN = {1'b1, {A-1{1'b0}}};
    localparam signed [W+1:0] ONE = {{W+1{1'b0}}, 1'b1};
    localparam [W-1:0] HALF_X = ({{W-1{1'b0}}, 1'b1} << G) >> 1;
    localparam [A-1:0] HALF_ANGLE = ({{A-1{1'b0}}, 1'b1} << G) >> 1;

    reg [A-1:0] rom [0:23];
    initial $readmemh(ROM_FILE, rom);
    wire signed [A-1:0] atan = rom[r_i];

    // the opposites take one bit more: minus full scale has none in 24
    wire signed [W-1:0] wide_x = {{G+1{x_in[23]}}, x_in};
    wire signed [W-1:0] wide_y = {{G+1{y_in[23]}}, y_in};
    wire signed [W-1:0] turned_x = x_in[23] ? -wide_x : wide_x;
    wire signed [W-1:0] turned_y = x_in[23] ? -wide_y : wide_y;

    // x and y in one signed format, with a guard bit for the rounding constant 2**(i - 1), which is 0 for i = 0
    wire signed [W+1:0] x = {2'b00, r_x};
    wire signed [W+1:0] y = {{2{r_y[W-1]}}, r_y};
    wire signed [W+1:0] half = (ONE <<< r_i) >>> 1;
    wire signed [W+1:0] across = (y + half) >>> r_i;
    wire signed [W+1:0] down = (x + half) >>> r_i;
    /* verilator lint_off UNUSED */         // waived: the guard bits, which repeat what stands below them
    wire signed [W+1:0] next_x = r_y[W-1] ? x - across : x + across;
    wire signed [W+1:0] next_y = r_y[W-1] ? y + down : y - down;
    /* verilator lint_on UNUSED */

    /* verilator lint_off UNUSED */         // waived: what rounding drops
    wire [W-1:0] magnitude = r_x + HALF_X;
    wire [A-1:0] phase = r_angle + HALF_ANGLE;
    /* verilator lint_on UNUSED */

    always @(posedge clk) begin
        if (rst) begin
            r_x         <= {W{1'b0}};
            r_y         <= {W{1'b0}};
            r_angle     <= {A{1'b0}};
            r_i         <= 5'd0;
            r_busy      <= 1'b0;
            r_done      <= 1'b0;
            r_magnitude <= 25'd0;
            r_phase     <= 24'sd0;
        end else if (start) begin
            r_x     <= turned_x <<< G;
            r_y     <= turned_y <<< G;
            r_angle <= x_in[23] ? HALF_TURN : {A{1'b0}};
            r_i     <= 5'd0;
            r_busy  <= 1'b1;
            r_done  <= 1'b0;
        end else if (!r_busy) begin
            r_done <= 1'b0;
        end else if (r_i < CLOCKS) begin
            r_i <= r_i + 5'd1;
            if (r_i < ITERATIONS) begin
                r_x     <= next_x[W-1:0];
                r_y     <= next_y[W-1:0];
                r_angle <= r_y[W-1] ? r_angle - atan : r_angle + atan;
            end
        end else begin
            r_busy      <= 1'b0;
            r_done      <= 1'b1;
            r_magnitude <= magnitude[W-1:G];
            r_phase     <= (r_x == {W{1'b0}}) ? 24'sd0 : phase[A-1:G];
        end
    end

endmodule
