// Vectoring CORDIC in one piece: all 24 rotations are combinational behind the loaded vector; a counter says when the
// result is taken, so that it comes when a design of one rotation per clock has it
module cordic_unrolled #(parameter TABLE = "") (
    input  logic clk, rst, go,
    input  logic signed [23:0] re, im,
    output logic [24:0] size,
    output logic signed [23:0] turn
);
    localparam int STEPS = 24, GUARD = 8;
    logic [31:0] atan [0:STEPS-1];
    initial $readmemh(TABLE, atan);

    logic signed [32:0] x0, y0;
    logic signed [31:0] a0;
    logic [4:0] wait_clocks;
    logic signed [34:0] x [0:STEPS], y [0:STEPS];
    logic signed [31:0] a [0:STEPS];
    assign x[0] = 35'(x0);
    assign y[0] = 35'(y0);
    assign a[0] = a0;
    generate for (genvar i = 0; i < STEPS; i++) begin : rotation
        localparam signed [34:0] HALF = (35'sd1 <<< i) >>> 1;
        wire signed [34:0] across = (y[i] + HALF) >>> i;
        wire signed [34:0] down = (x[i] + HALF) >>> i;
        assign x[i+1] = y[i] < 0 ? x[i] - across : x[i] + across;
        assign y[i+1] = y[i] < 0 ? y[i] + down : y[i] - down;
        assign a[i+1] = y[i] < 0 ? a[i] - $signed(atan[i]) : a[i] + $signed(atan[i]);
    end endgenerate
    wire signed [34:0] rounded = x[STEPS] + 35'sd128;
    wire signed [31:0] angle = a[STEPS] + 32'sd128;

    always_ff @(posedge clk)
        if (rst) begin
            {x0, y0, a0, wait_clocks, size, turn} <= '0;
        end else if (go) begin
            x0 <= (re < 0 ? -33'(re) : 33'(re)) <<< GUARD;
            y0 <= (re < 0 ? -33'(im) : 33'(im)) <<< GUARD;
            a0 <= re < 0 ? 32'sh80000000 : '0;
            wait_clocks <= 5'd25;
        end else if (wait_clocks != 0) begin
            wait_clocks <= wait_clocks - 5'd1;
            if (wait_clocks == 1) begin
                size <= rounded[32:GUARD];
                turn <= x[STEPS] == 0 ? '0 : angle[31:GUARD];
            end
        end
endmodule
