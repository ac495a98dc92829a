// Phase accumulator and four phases; carries rest one clock between the halves of a sum.
module nco (
    input  wire         clk,
    input  wire [47:0]  tune,
    input  wire [191:0] shifts,      // drive sine lowest, sense reference highest
    output wire [191:0] turns
);
    reg [23:0] acc_l = 0, acc_h = 0, tune_h = 0;
    reg        carry = 0;
    always @(posedge clk) begin
        {carry, acc_l} <= {1'b0, acc_l} + tune[23:0];
        tune_h <= tune[47:24];
        acc_h  <= acc_h + tune_h + carry;
    end
    genvar k;
    generate for (k = 0; k < 4; k = k + 1) begin : tap
        half_adder48 u (.clk(clk), .low(acc_l), .high(acc_h), .add(shifts[48*k +: 48]), .sum(turns[48*k +: 48]));
    end endgenerate
endmodule
