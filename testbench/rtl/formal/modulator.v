// Properties of gyro_modulator with lo <= 0 <= hi: codes stay within their limits, and no polarity flips.
module prove_modulator #(
    parameter [5:0] shift = 6'd0,
    parameter signed [19:0] lo = 20'sd0,
    parameter signed [19:0] hi = 20'sd0
) (
    input wire clk,
    input wire rst,
    input wire en_code,
    input wire signed [41:0] r_product,
    input wire signed [19:0] r_code,
    input wire signed [19:0] r_held1,
    input wire signed [19:0] r_held2,
    input wire signed [19:0] o_out
);

    // products from which the r_code is at its limit
    localparam signed [62:0] TOP = hi * (63'sd1 <<< shift), BOTTOM = lo * (63'sd1 <<< shift);

    reg begun = 1'b0;
    reg was_rst, was_en;
    reg signed [41:0] was_product;
    reg signed [19:0] was_code, was_held1;
    always @(posedge clk) begin
        begun       <= 1'b1;
        was_rst     <= rst;
        was_en      <= en_code;
        was_product <= r_product;
        was_code    <= r_code;
        was_held1   <= r_held1;
    end

    wire signed [62:0] wide = {{21{was_product[41]}}, was_product};

    always @* begin
        if (!begun)
            assume (rst);
        else begin
            code_within: assert (r_code >= lo && r_code <= hi);
            out_within: assert (o_out >= lo && o_out <= hi);
            held_within: assert (r_held1 >= lo && r_held1 <= hi && r_held2 >= lo && r_held2 <= hi);
            if (was_rst)
                resets: assert (r_product == 42'sd0 && r_code == 20'sd0 && r_held1 == 20'sd0 && r_held2 == 20'sd0);
            else if (was_en) begin
                no_negative_from_positive: assert (was_product < 42'sd0 || r_code >= 20'sd0);
                no_positive_from_negative: assert (was_product > 42'sd0 || r_code <= 20'sd0);
                at_the_top: assert (wide < TOP || r_code == hi);
                at_the_bottom: assert (wide > BOTTOM || r_code == lo);
                moves_on: assert (r_held1 == was_code && r_held2 == was_held1);
            end else
                holds: assert (r_code == was_code && r_held1 == was_held1);
        end
    end

endmodule
