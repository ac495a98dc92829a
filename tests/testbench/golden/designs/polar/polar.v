// Cartesian to polar, one register stage for each rotation.
module polar (
    input  wire               clk, srst_n, in_valid,
    input  wire signed [23:0] re, im,
    output reg         [24:0] mag,
    output reg  signed [23:0] arg
);
    wire signed [33:0] xs [0:24];
    wire signed [33:0] ys [0:24];
    wire        [31:0] zs [0:24];
    wire        [24:0] vs;

    // left half-plane: turned by half a turn
    reg signed [33:0] x0, y0;
    reg [31:0] z0;
    reg v0;
    wire signed [33:0] re_w = {{2{re[23]}}, re, 8'd0};
    wire signed [33:0] im_w = {{2{im[23]}}, im, 8'd0};
    always @(posedge clk) begin
        v0 <= in_valid && srst_n;
        x0 <= re[23] ? -re_w : re_w;
        y0 <= re[23] ? -im_w : im_w;
        z0 <= {re[23], 31'd0};
    end
    assign xs[0] = x0;
    assign ys[0] = y0;
    assign zs[0] = z0;
    assign vs[0] = v0;

    genvar k;
    generate for (k = 0; k < 24; k = k + 1) begin : rot
        rotation #(.K(k)) u (.clk(clk), .kill(in_valid || !srst_n),
            .x(xs[k]), .y(ys[k]), .z(zs[k]), .v(vs[k]),
            .x_q(xs[k+1]), .y_q(ys[k+1]), .z_q(zs[k+1]), .v_q(vs[k+1]));
    end endgenerate

    wire signed [33:0] m = (xs[24] + 34'sd128) >>> 8;
    wire [31:0] a = zs[24] + 32'd128;
    always @(posedge clk)
        if (!srst_n) begin
            mag <= 0;
            arg <= 0;
        end else if (vs[24] && !in_valid) begin
            mag <= m[24:0];
            arg <= (xs[24] == 0) ? 24'd0 : a[31:8];
        end
endmodule
