// Watchdog of the ADC: microseconds since the last frame, and a flag when frames have stopped coming.
//   frame = 1: age = 0, stale = 0     ce_1m = 1: age = age + 1, stale = 1 once age is beyond limit
// Latency: 1 clock from a frame to stale = 0; limit + 1 ticks without one to stale = 1. No rounding.
// age saturates at the top of its format.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_watchdog #(
    parameter [9:0] limit = 10'd0  // [0,10,0] us
) (
    input  wire       clk,
    input  wire       rst,         // synchronous, active high
    input  wire       ce_1m,
    input  wire       frame,
    output reg  [9:0] r_age,       // [0,10,0] us
    output reg        r_stale
);

    localparam [9:0] AGE_TOP = 10'd1023;

    wire [9:0] next_age = (r_age == AGE_TOP) ? AGE_TOP : r_age + 10'd1;

    always @(posedge clk) begin
        if (rst || frame) begin
            r_age   <= 10'd0;
            r_stale <= 1'b0;
        end else if (ce_1m) begin
            r_age   <= next_age;
            r_stale <= (next_age > limit) || r_stale;
        end
    end

endmodule
