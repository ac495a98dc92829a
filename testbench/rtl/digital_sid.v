// Synchronous integral demodulator: sign x sample, integrate and dump, then three one-pole low-passes and a gain.
//   at dump: pole1 += round(alpha*(acc - pole1)), acc = +-x; then pole2, pole3, codes one clock each
//   ok with the codes: no sample has rested for `still` ticks; 0 switches that off
// Latency: 4 clocks from dump to valid.   Rounding: ties toward +inf in each pole and in the codes.
// Overflow: acc, codes and still saturate; the poles cannot overflow. dump acts with ce_1m only.
// Order: 0 drive sin, 1 drive cos, 2 sense sin, 3 sense cos.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_digital_sid #(
    parameter [19:0] alpha     = 20'd0,      // [0,0,20]
    parameter [20:0] gain_x    = 21'd0,      // [0,4,17]
    parameter [20:0] gain_y    = 21'd0,      // [0,4,17]
    parameter  [2:0] ref_delay = 3'd0,       // 0 .. 4 ticks
    parameter [11:0] still     = 12'd0       // [0,12,0] ticks
) (
    input  wire               clk,
    input  wire               rst,           // synchronous, active high
    input  wire               ce_1m,
    input  wire               dump,
    input  wire         [3:0] refs,
    input  wire signed [17:0] sample_x,      // [1,17,0]
    input  wire signed [17:0] sample_y,      // [1,17,0]
    output reg          [3:0] r_refs_0,
    output reg          [3:0] r_refs_1,
    output reg          [3:0] r_refs_2,
    output reg          [3:0] r_refs_3,
    output reg  signed [24:0] r_acc_0,       // [1,24,0]
    output reg  signed [24:0] r_acc_1,
    output reg  signed [24:0] r_acc_2,
    output reg  signed [24:0] r_acc_3,
    output reg  signed [40:0] r_pole1_0,     // [1,24,16]
    output reg  signed [40:0] r_pole1_1,
    output reg  signed [40:0] r_pole1_2,
    output reg  signed [40:0] r_pole1_3,
    output reg  signed [40:0] r_pole2_0,
    output reg  signed [40:0] r_pole2_1,
    output reg  signed [40:0] r_pole2_2,
    output reg  signed [40:0] r_pole2_3,
    output reg  signed [40:0] r_pole3_0,
    output reg  signed [40:0] r_pole3_1,
    output reg  signed [40:0] r_pole3_2,
    output reg  signed [40:0] r_pole3_3,
    output reg          [1:0] r_stage,       // [0,2,0] pole that has just been computed
    output reg  signed [23:0] r_codes_0,     // [1,23,0]
    output reg  signed [23:0] r_codes_1,
    output reg  signed [23:0] r_codes_2,
    output reg  signed [23:0] r_codes_3,
    output reg                r_valid,
    output reg  signed [17:0] r_last_0,      // [1,17,0] samples of the tick before
    output reg  signed [17:0] r_last_1,
    output reg         [11:0] r_still,       // [0,12,0]
    output reg                r_ok
);

    localparam signed [25:0] ACC_LO = -26'sd16777216, ACC_HI = 26'sd16777215;
    localparam signed [29:0] CODE_LO = -30'sd8388608, CODE_HI = 30'sd8388607;
    localparam signed [62:0] ALPHA = {43'd0, alpha};
    localparam signed [62:0] GAIN_X = {42'd0, gain_x};
    localparam signed [62:0] GAIN_Y = {42'd0, gain_y};

    // a bit more than a sample: minus full scale has an opposite there
    function signed [18:0] with_sign;
        input               positive;
        input signed [17:0] x;
        reg   signed [18:0] wide;
        begin
            wide = {x[17], x};
            with_sign = positive ? wide : -wide;
        end
    endfunction

    function signed [24:0] summed;
        input signed [24:0] acc;
        input signed [18:0] x;
        reg   signed [25:0] sum;
        begin
            sum = {acc[24], acc} + {{7{x[18]}}, x};
            summed = (sum < ACC_LO) ? ACC_LO[24:0] : (sum > ACC_HI) ? ACC_HI[24:0] : sum[24:0];
        end
    endfunction

    /* verilator lint_off UNUSED */          // waived: what rounding drops, and signs that saturation has made needless
    // y + round(alpha*(x - y)): a mean of x and y, so 41 bits hold it
    function signed [40:0] filtered;
        input signed [40:0] y;
        input signed [40:0] x;
        reg   signed [62:0] difference;
        reg   signed [62:0] product;
        begin
            difference = {{22{x[40]}}, x} - {{22{y[40]}}, y};
            product = ALPHA * difference + 63'sd524288;
            filtered = y + product[60:20];
        end
    endfunction

    function signed [23:0] code_of;
        input signed [62:0] gain;
        input signed [40:0] y;
        reg   signed [62:0] product;
        reg   signed [29:0] rounded;
        begin
            product = gain * {{22{y[40]}}, y} + 63'sd4294967296;
            rounded = product[62:33];
            code_of = (rounded < CODE_LO) ? CODE_LO[23:0] : (rounded > CODE_HI) ? CODE_HI[23:0] : rounded[23:0];
        end
    endfunction
    /* verilator lint_on UNUSED */

    wire [3:0] now = (ref_delay == 3'd0) ? refs :
                     (ref_delay == 3'd1) ? r_refs_0 :
                     (ref_delay == 3'd2) ? r_refs_1 :
                     (ref_delay == 3'd3) ? r_refs_2 : r_refs_3;
    wire rests = (sample_x == r_last_0) || (sample_y == r_last_1);
    wire signed [18:0] x_0 = with_sign(now[0], sample_x);
    wire signed [18:0] x_1 = with_sign(now[1], sample_x);
    wire signed [18:0] x_2 = with_sign(now[2], sample_y);
    wire signed [18:0] x_3 = with_sign(now[3], sample_y);

    always @(posedge clk) begin
        if (rst) begin
            r_refs_0  <= 4'd0;
            r_refs_1  <= 4'd0;
            r_refs_2  <= 4'd0;
            r_refs_3  <= 4'd0;
            r_acc_0   <= 25'sd0;
            r_acc_1   <= 25'sd0;
            r_acc_2   <= 25'sd0;
            r_acc_3   <= 25'sd0;
            r_pole1_0 <= 41'sd0;
            r_pole1_1 <= 41'sd0;
            r_pole1_2 <= 41'sd0;
            r_pole1_3 <= 41'sd0;
            r_pole2_0 <= 41'sd0;
            r_pole2_1 <= 41'sd0;
            r_pole2_2 <= 41'sd0;
            r_pole2_3 <= 41'sd0;
            r_pole3_0 <= 41'sd0;
            r_pole3_1 <= 41'sd0;
            r_pole3_2 <= 41'sd0;
            r_pole3_3 <= 41'sd0;
            r_stage   <= 2'd0;
            r_codes_0 <= 24'sd0;
            r_codes_1 <= 24'sd0;
            r_codes_2 <= 24'sd0;
            r_codes_3 <= 24'sd0;
            r_valid   <= 1'b0;
            r_last_0  <= 18'sd0;
            r_last_1  <= 18'sd0;
            r_still   <= 12'd0;
            r_ok      <= 1'b0;
        end else begin
            r_stage <= 2'd0;
            r_valid <= 1'b0;
            case (r_stage)
                2'd1: begin
                    r_pole2_0 <= filtered(r_pole2_0, r_pole1_0);
                    r_pole2_1 <= filtered(r_pole2_1, r_pole1_1);
                    r_pole2_2 <= filtered(r_pole2_2, r_pole1_2);
                    r_pole2_3 <= filtered(r_pole2_3, r_pole1_3);
                    r_stage   <= 2'd2;
                end
                2'd2: begin
                    r_pole3_0 <= filtered(r_pole3_0, r_pole2_0);
                    r_pole3_1 <= filtered(r_pole3_1, r_pole2_1);
                    r_pole3_2 <= filtered(r_pole3_2, r_pole2_2);
                    r_pole3_3 <= filtered(r_pole3_3, r_pole2_3);
                    r_stage   <= 2'd3;
                end
                2'd3: begin
                    r_codes_0 <= code_of(GAIN_X, r_pole3_0);
                    r_codes_1 <= code_of(GAIN_X, r_pole3_1);
                    r_codes_2 <= code_of(GAIN_Y, r_pole3_2);
                    r_codes_3 <= code_of(GAIN_Y, r_pole3_3);
                    r_valid   <= 1'b1;
                    r_ok      <= !(still != 12'd0 && r_still == still);
                end
                default: ;
            endcase
            if (ce_1m) begin
                r_refs_0 <= refs;
                r_refs_1 <= r_refs_0;
                r_refs_2 <= r_refs_1;
                r_refs_3 <= r_refs_2;
                r_last_0 <= sample_x;
                r_last_1 <= sample_y;
                r_still  <= !rests ? 12'd0 : (r_still >= still) ? still : r_still + 12'd1;
                if (dump) begin
                    r_acc_0   <= {{6{x_0[18]}}, x_0};
                    r_acc_1   <= {{6{x_1[18]}}, x_1};
                    r_acc_2   <= {{6{x_2[18]}}, x_2};
                    r_acc_3   <= {{6{x_3[18]}}, x_3};
                    r_pole1_0 <= filtered(r_pole1_0, {r_acc_0, 16'd0});
                    r_pole1_1 <= filtered(r_pole1_1, {r_acc_1, 16'd0});
                    r_pole1_2 <= filtered(r_pole1_2, {r_acc_2, 16'd0});
                    r_pole1_3 <= filtered(r_pole1_3, {r_acc_3, 16'd0});
                    r_stage   <= 2'd1;
                end else begin
                    r_acc_0 <= summed(r_acc_0, x_0);
                    r_acc_1 <= summed(r_acc_1, x_1);
                    r_acc_2 <= summed(r_acc_2, x_2);
                    r_acc_3 <= summed(r_acc_3, x_3);
                end
            end
        end
    end

endmodule
