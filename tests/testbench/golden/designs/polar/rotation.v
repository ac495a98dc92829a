// Rotation by atan(2^-K) towards the x axis.
module rotation #(parameter K = 0) (
    input  wire               clk, kill, v,
    input  wire signed [33:0] x, y,
    input  wire        [31:0] z,
    output reg  signed [33:0] x_q, y_q,
    output reg         [31:0] z_q,
    output reg                v_q
);
    `include "atan.vh"
    localparam [31:0] STEP = ATAN[32*(23-K) +: 32];
    localparam signed [33:0] HALF = (K == 0) ? 0 : 34'sd1 <<< (K == 0 ? 0 : K - 1);
    wire signed [33:0] dx = (x + HALF) >>> K;
    wire signed [33:0] dy = (y + HALF) >>> K;
    always @(posedge clk) begin
        v_q <= v && !kill;
        x_q <= y[33] ? x - dy : x + dy;
        y_q <= y[33] ? y + dx : y - dx;
        z_q <= y[33] ? z - STEP : z + STEP;
    end
endmodule
