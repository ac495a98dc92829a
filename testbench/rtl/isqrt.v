// Integer square root, one result bit per clock: y = floor(sqrt(u)), remainder = u - root**2.
//   pair = 4*remainder + two top bits of radicand;   trial = 4*root + 1;   pair >= trial gives the next bit of root
// Latency: 17 clocks from start to done = 1; y stays until the next result. A start while busy begins anew.
// Rounding: toward zero, exact.   No overflow: remainder never exceeds 2*root; radicand drops the bits already used.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_isqrt (
    input  wire        clk,
    input  wire        rst,          // synchronous, active high
    input  wire        start,
    input  wire [31:0] u,            // [0,32,0]
    output reg  [31:0] r_radicand,   // [0,32,0]
    output reg  [15:0] r_root,       // [0,16,0]
    output reg  [16:0] r_remainder,  // [0,17,0]
    output reg   [3:0] r_i,
    output reg         r_busy,
    output reg         r_done,
    output reg  [15:0] r_y           // [0,16,0]
);

    localparam [3:0] LAST = 4'd15;

    wire [18:0] pair = {r_remainder, r_radicand[31:30]};
    wire [18:0] trial = {1'b0, r_root, 2'b01};
    // one bit more: the sign of the difference is the comparison. Its other upper bits are 0 when the next bit is 1.
    /* verilator lint_off UNUSED */  // waived: those upper bits
    wire [19:0] less = {1'b0, pair} - {1'b0, trial};
    /* verilator lint_on UNUSED */
    wire        fits = ~less[19];
    wire [15:0] next_root = {r_root[14:0], fits};
    wire        last = (r_i == LAST);

    always @(posedge clk) begin
        if (rst) begin
            r_radicand  <= 32'd0;
            r_root      <= 16'd0;
            r_remainder <= 17'd0;
            r_i         <= 4'd0;
            r_busy      <= 1'b0;
            r_done      <= 1'b0;
            r_y         <= 16'd0;
        end else if (start) begin
            r_radicand  <= u;
            r_root      <= 16'd0;
            r_remainder <= 17'd0;
            r_i         <= 4'd0;
            r_busy      <= 1'b1;
            r_done      <= 1'b0;
        end else begin
            r_busy <= r_busy & ~last;
            r_done <= r_busy & last;
            if (r_busy) begin
                r_radicand  <= {r_radicand[29:0], 2'b00};
                r_root      <= next_root;
                r_remainder <= fits ? less[16:0] : pair[16:0];
                r_i         <= r_i + 4'd1;
                if (last)
                    r_y <= next_root;
            end
        end
    end

endmodule
