// Amplitude times sine to a DAC code, rounded and saturated, with up to two frames of delay.
// Latency: 2 clocks from amplitude and sine to code when en_code follows en_product; frames more enables to o_out.
// Rounding: ties toward +inf at code, product exact.   Overflow: code saturates at lo and hi.
// shift is SINE_BITS + 23 - n for a code of n bits; the widths below hold for shift <= SINE_BITS + 23.
// Formats are those of the default design.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_modulator #(
    parameter               SINE_BITS = 18,      // width of the sine
    parameter         [5:0] shift     = 6'd0,    // [0,6,0]
    parameter signed [19:0] lo        = 20'sd0,  // [1,19,0]
    parameter signed [19:0] hi        = 20'sd0,  // [1,19,0]
    parameter         [1:0] frames    = 2'd0     // 0, 1, 2
) (
    input  wire                         clk,
    input  wire                         rst,         // synchronous, active high
    input  wire                         en_product,
    input  wire                         en_code,
    input  wire signed           [23:0] amplitude,   // [1,0,23]
    input  wire signed  [SINE_BITS-1:0] sine,        // [1,0,17]
    output reg  signed [SINE_BITS+23:0] r_product,   // [1,1,40]
    output reg  signed           [19:0] r_code,      // [1,19,0]
    output reg  signed           [19:0] r_held1,
    output reg  signed           [19:0] r_held2,
    output wire signed           [19:0] o_out
);

    localparam PRODUCT = SINE_BITS + 24;

    wire signed [PRODUCT-1:0] wide_amplitude = {{SINE_BITS{amplitude[23]}}, amplitude};
    wire signed [PRODUCT-1:0] wide_sine = {{24{sine[SINE_BITS-1]}}, sine};

    // one bit more than the product, so that the rounding constant cannot overflow
    localparam signed [PRODUCT:0] HALF = ({{PRODUCT{1'b0}}, 1'b1} << shift) >> 1;
    localparam signed [PRODUCT:0] LO = {{SINE_BITS+5{lo[19]}}, lo};
    localparam signed [PRODUCT:0] HI = {{SINE_BITS+5{hi[19]}}, hi};
    // a net of its own: >>> on a concatenation, which is unsigned, would not extend the sign
    wire signed [PRODUCT:0] wide_product = {r_product[PRODUCT-1], r_product};
    wire signed [PRODUCT:0] rounded = (wide_product + HALF) >>> shift;

    assign o_out = (frames == 2'd1) ? r_held1 :
                   (frames == 2'd2) ? r_held2 : r_code;

    always @(posedge clk) begin
        if (rst) begin
            r_product <= {PRODUCT{1'b0}};
            r_code    <= 20'sd0;
            r_held1   <= 20'sd0;
            r_held2   <= 20'sd0;
        end else begin
            if (en_product)
                r_product <= wide_amplitude * wide_sine;
            if (en_code) begin
                r_code  <= (rounded < LO) ? lo : (rounded > HI) ? hi : rounded[19:0];
                r_held1 <= r_code;
                r_held2 <= r_held1;
            end
        end
    end

endmodule
