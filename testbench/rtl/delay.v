// Pipeline delay of 0 to 8 clocks: o_out is x, or the chosen tap.
// Latency: depth clocks from x to o_out.   With depth 0 the taps stay at reset, as in the model.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_delay #(
    parameter       SINE_BITS = 18,   // width of the words
    parameter [3:0] depth     = 4'd0  // 0 .. 8
) (
    input  wire                        clk,
    input  wire                        rst,       // synchronous, active high
    input  wire signed [SINE_BITS-1:0] x,         // [1,0,SINE_BITS-1]
    output reg  signed [SINE_BITS-1:0] r_taps_0,  // [1,0,SINE_BITS-1]
    output reg  signed [SINE_BITS-1:0] r_taps_1,
    output reg  signed [SINE_BITS-1:0] r_taps_2,
    output reg  signed [SINE_BITS-1:0] r_taps_3,
    output reg  signed [SINE_BITS-1:0] r_taps_4,
    output reg  signed [SINE_BITS-1:0] r_taps_5,
    output reg  signed [SINE_BITS-1:0] r_taps_6,
    output reg  signed [SINE_BITS-1:0] r_taps_7,
    output wire signed [SINE_BITS-1:0] o_out
);

    assign o_out = (depth == 4'd0) ? x :
                   (depth == 4'd1) ? r_taps_0 :
                   (depth == 4'd2) ? r_taps_1 :
                   (depth == 4'd3) ? r_taps_2 :
                   (depth == 4'd4) ? r_taps_3 :
                   (depth == 4'd5) ? r_taps_4 :
                   (depth == 4'd6) ? r_taps_5 :
                   (depth == 4'd7) ? r_taps_6 : r_taps_7;

    always @(posedge clk) begin
        if (rst) begin
            r_taps_0 <= {SINE_BITS{1'b0}};
            r_taps_1 <= {SINE_BITS{1'b0}};
            r_taps_2 <= {SINE_BITS{1'b0}};
            r_taps_3 <= {SINE_BITS{1'b0}};
            r_taps_4 <= {SINE_BITS{1'b0}};
            r_taps_5 <= {SINE_BITS{1'b0}};
            r_taps_6 <= {SINE_BITS{1'b0}};
            r_taps_7 <= {SINE_BITS{1'b0}};
        end else if (depth != 4'd0) begin
            r_taps_0 <= x;
            r_taps_1 <= r_taps_0;
            r_taps_2 <= r_taps_1;
            r_taps_3 <= r_taps_2;
            r_taps_4 <= r_taps_3;
            r_taps_5 <= r_taps_4;
            r_taps_6 <= r_taps_5;
            r_taps_7 <= r_taps_6;
        end
    end

endmodule
