// Properties of gyro_pi with lo <= 0 <= hi: saturation, and that nothing changes sign by overflow.
module prove_pi #(
    parameter signed [33:0] ki = 34'sd0,
    parameter signed [35:0] lo = 36'sd0,
    parameter signed [35:0] hi = 36'sd0
) (
    input wire clk,
    input wire rst,
    input wire en,
    input wire [1:0] mode,
    input wire signed [25:0] e,
    input wire signed [35:0] preset,
    input wire signed [59:0] r_prop,
    input wire signed [59:0] r_acc,
    input wire signed [35:0] r_y
);

    localparam [1:0] OFF = 2'd0, RUN = 2'd2;
    localparam signed [59:0] ACC_LO = {lo, 24'd0}, ACC_HI = {hi, 24'd0};

    reg begun = 1'b0;
    reg was_rst, was_en;
    reg [1:0] was_mode;
    reg signed [25:0] was_e;
    reg signed [35:0] was_preset;
    reg signed [60:0] was_sum;
    reg signed [59:0] was_acc;
    always @(posedge clk) begin
        begun      <= 1'b1;
        was_rst    <= rst;
        was_en     <= en;
        was_mode   <= mode;
        was_e      <= e;
        was_preset <= preset;
        was_sum    <= {r_prop[59], r_prop} + {r_acc[59], r_acc};
        was_acc    <= r_acc;
    end

    wire signed [60:0] top = {hi[35], ACC_HI};
    // where the error may move the integrator
    wire up = (ki > 34'sd0) ? was_e > 26'sd0 : was_e < 26'sd0;
    wire down = (ki > 34'sd0) ? was_e < 26'sd0 : was_e > 26'sd0;

    always @* begin
        if (!begun)
            assume (rst);
        else begin
            y_within: assert (r_y >= lo && r_y <= hi);
            acc_within: assert (r_acc >= ACC_LO && r_acc <= ACC_HI);
            if (was_rst)
                resets: assert (r_prop == 60'sd0 && r_acc == 60'sd0 && r_y == 36'sd0);
            else begin
                no_negative_from_positive: assert (was_sum < 61'sd0 || r_y >= 36'sd0);
                no_positive_from_negative: assert (was_sum >= 61'sd0 || r_y <= 36'sd0);
                y_at_its_limit: assert (was_sum < top || r_y == hi);
                if (was_en && was_mode == OFF)
                    preset_taken: assert (r_acc == ((was_preset < lo) ? ACC_LO : (was_preset > hi) ? ACC_HI :
                                                  {was_preset, 24'd0}));
                else if (was_en && was_mode == RUN)
                    with_the_error: assert ((up || r_acc <= was_acc) && (down || r_acc >= was_acc));
                else
                    holds: assert (r_acc == was_acc);
            end
        end
    end

endmodule
