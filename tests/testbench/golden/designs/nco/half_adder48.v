// low + add[23:0] in one clock, high + add[47:24] + carry in the next; high is one clock behind low.
module half_adder48 (
    input  wire        clk,
    input  wire [23:0] low, high,
    input  wire [47:0] add,
    output wire [47:0] sum
);
    reg [23:0] s_l = 0, s_l2 = 0, s_h = 0, add_h = 0;
    reg        c = 0;
    always @(posedge clk) begin
        {c, s_l} <= {1'b0, low} + add[23:0];
        add_h    <= add[47:24];
        s_h      <= high + add_h + c;
        s_l2     <= s_l;
    end
    assign sum = {s_h, s_l2};
endmodule
