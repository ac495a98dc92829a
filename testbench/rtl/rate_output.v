// Rate output: bias and scale with temperature polynomials, then a mean over 2**k frames.
//   corrected = word - (b0 + b1*t + b2*t2);   scaled = corrected*(s0 + s1*t + s2*t2);   y = mean of 2**k of scaled
// Latency: 6 clocks from the last en of a mean to valid = 1, one clock long. One en in any six clocks; the seven
// register values must stand for that long.   Rounding: ties toward +inf in t2, scale, corrected, scaled, y; t is cut.
// Overflow: scale, corrected and scaled saturate; bias, acc and y cannot. decimation 7 counts as 6.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_rate_output (
    input  wire               clk,
    input  wire               rst,          // synchronous, active high
    input  wire signed [31:0] bias,         // [1,23,8]
    input  wire signed [31:0] bias_t1,      // [1,7,24]
    input  wire signed [31:0] bias_t2,      // [1,7,24]
    input  wire signed [29:0] scale,        // [1,1,28]
    input  wire signed [23:0] scale_t1,     // [1,-17,40]
    input  wire signed [23:0] scale_t2,     // [1,-17,40]
    input  wire         [2:0] decimation,
    input  wire               en,
    input  wire signed [23:0] word,         // [1,23,0]
    /* verilator lint_off UNUSED */         // waived: t is cut from the temperature
    input  wire signed [23:0] temperature,  // [1,23,0]
    /* verilator lint_on UNUSED */
    output reg          [4:0] r_stage,
    output reg  signed [23:0] r_word,       // [1,23,0]
    output reg  signed [15:0] r_t,          // [1,15,0]
    output reg         [15:0] r_t2,         // [0,16,0]
    output reg  signed [49:0] r_bias,       // [1,25,24]
    output reg  signed [29:0] r_scale,      // [1,1,28]
    output reg  signed [31:0] r_corrected,  // [1,23,8]
    output reg  signed [31:0] r_scaled,     // [1,11,20] deg/s
    output reg  signed [37:0] r_acc,        // [1,17,20]
    output reg          [5:0] r_count,
    output reg          [2:0] r_k,
    output reg  signed [31:0] r_y,          // [1,11,20] deg/s
    output reg                r_valid
);

    localparam [2:0] MAX_K = 3'd6;
    // limits, each in the width it is compared in: a sign and then the bits of the format
    localparam signed [31:0] SCALE_LO = {3'b111, 29'd0}, SCALE_HI = {3'b000, {29{1'b1}}};
    localparam signed [35:0] CORRECTED_LO = {5'b11111, 31'd0}, CORRECTED_HI = {5'b00000, {31{1'b1}}};
    localparam signed [34:0] OUT_LO = {4'b1111, 31'd0}, OUT_HI = {4'b0000, {31{1'b1}}};

    /* verilator lint_off UNUSED */         // waived: what rounding drops, here and below

    wire signed [31:0] square_t = {{16{r_t[15]}}, r_t};
    wire signed [31:0] square = square_t * square_t + 32'sd16384;

    // both polynomials: every operand in the width of the sum
    wire signed [49:0] bias_t = {{34{r_t[15]}}, r_t};
    wire signed [49:0] bias_square = {34'd0, r_t2};
    wire signed [49:0] wide_bias = {{2{bias[31]}}, bias, 16'd0};
    wire signed [49:0] wide_bias_t1 = {{18{bias_t1[31]}}, bias_t1};
    wire signed [49:0] wide_bias_t2 = {{18{bias_t2[31]}}, bias_t2};
    wire signed [49:0] bias_sum = wide_bias + wide_bias_t1 * bias_t + wide_bias_t2 * bias_square;

    wire signed [43:0] scale_t = {{28{r_t[15]}}, r_t};
    wire signed [43:0] scale_square = {28'd0, r_t2};
    wire signed [43:0] wide_scale = {{2{scale[29]}}, scale, 12'd0};
    wire signed [43:0] wide_scale_t1 = {{20{scale_t1[23]}}, scale_t1};
    wire signed [43:0] wide_scale_t2 = {{20{scale_t2[23]}}, scale_t2};
    wire signed [43:0] scale_sum = wide_scale + wide_scale_t1 * scale_t + wide_scale_t2 * scale_square + 44'sd2048;
    wire signed [31:0] rounded_scale = scale_sum[43:12];
    wire signed [31:0] clamped_scale = (rounded_scale < SCALE_LO) ? SCALE_LO :
                                       (rounded_scale > SCALE_HI) ? SCALE_HI : rounded_scale;

    // one bit more than the difference, so that the rounding constant cannot overflow
    wire signed [51:0] difference = {{4{r_word[23]}}, r_word, 24'd0} - {{2{r_bias[49]}}, r_bias} + 52'sd32768;
    wire signed [35:0] rounded_difference = difference[51:16];
    wire signed [35:0] clamped_difference = (rounded_difference < CORRECTED_LO) ? CORRECTED_LO :
                                            (rounded_difference > CORRECTED_HI) ? CORRECTED_HI : rounded_difference;

    wire signed [62:0] wide_corrected = {{31{r_corrected[31]}}, r_corrected};
    wire signed [62:0] product_scale = {{33{r_scale[29]}}, r_scale};
    wire signed [62:0] product = wide_corrected * product_scale + 63'sd134217728;
    wire signed [34:0] rounded_product = product[62:28];
    wire signed [34:0] clamped_product = (rounded_product < OUT_LO) ? OUT_LO :
                                         (rounded_product > OUT_HI) ? OUT_HI : rounded_product;

    // the mean: k is taken over when one starts
    wire        first = (r_count == 6'd0);
    wire  [2:0] k = !first ? r_k : (decimation > MAX_K) ? MAX_K : decimation;
    wire signed [37:0] acc = (first ? 38'sd0 : r_acc) + {{6{r_scaled[31]}}, r_scaled};
    wire  [6:0] count = {1'b0, r_count} + 7'd1;
    wire        last = (count == (7'd1 << k));
    wire signed [38:0] wide_acc = {acc[37], acc};
    wire signed [38:0] half = (39'sd1 <<< k) >>> 1;
    wire signed [38:0] mean = (wide_acc + half) >>> k;

    /* verilator lint_on UNUSED */

    always @(posedge clk) begin
        if (rst) begin
            r_stage     <= 5'd0;
            r_word      <= 24'sd0;
            r_t         <= 16'sd0;
            r_t2        <= 16'd0;
            r_bias      <= 50'sd0;
            r_scale     <= 30'sd0;
            r_corrected <= 32'sd0;
            r_scaled    <= 32'sd0;
            r_acc       <= 38'sd0;
            r_count     <= 6'd0;
            r_k         <= 3'd0;
            r_y         <= 32'sd0;
            r_valid     <= 1'b0;
        end else begin
            r_stage <= {r_stage[3:0], en};
            r_valid <= r_stage[4] & last;
            if (en) begin
                r_word <= word;
                r_t    <= temperature[23:8];
            end
            if (r_stage[0])
                r_t2 <= square[30:15];
            if (r_stage[1]) begin
                r_bias  <= bias_sum;
                r_scale <= clamped_scale[29:0];
            end
            if (r_stage[2])
                r_corrected <= clamped_difference[31:0];
            if (r_stage[3])
                r_scaled <= clamped_product[31:0];
            if (r_stage[4]) begin
                r_acc   <= acc;
                r_count <= last ? 6'd0 : count[5:0];
                r_k     <= k;
                if (last)
                    r_y <= mean[31:0];
            end
        end
    end

endmodule
