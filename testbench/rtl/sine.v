// Sine from a quarter-wave table with linear interpolation.
//   y = +-round(base[a] + slope[a] * (f + 1/2) / 2**SINE_FRACTION_BITS); a, f complemented in odd quadrants, minus in
//   quadrants 2 and 3
// Latency: 3 clocks from phase to y.   Rounding: magnitude, ties up.   No overflow: the table tops out at full scale,
// 2**(SINE_BITS - 1) - 1.   Formats are those of the default design.
// ROM_FILE: 2**SINE_ADDRESS_BITS hex words, base [0,17,6] above slope [0,8,5]; no default would hide its absence.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_sine #(
    parameter DDS_BITS           = 48,  // width of the phase
    parameter SINE_ADDRESS_BITS  = 10,  // rows of the table, as a power of two
    parameter SINE_FRACTION_BITS = 10,  // interpolation between two rows
    parameter SINE_BITS          = 18,  // width of y
    parameter ROM_FILE = ""
) (
    input  wire                                                             clk,
    input  wire                                                             rst,         // synchronous, active high
    /* verilator lint_off UNUSED */  // waived: the lower bits of the phase are cut
    input  wire                                              [DDS_BITS-1:0] phase,       // [0,0,48] turns
    /* verilator lint_on UNUSED */
    output reg                                                              r_sign,
    output reg                                              [SINE_BITS+4:0] r_base,      // [0,17,6]
    output reg                            [SINE_BITS-SINE_ADDRESS_BITS+4:0] r_slope,     // [0,8,5]
    output reg                                     [SINE_FRACTION_BITS-1:0] r_fraction,  // [0,0,10]
    output reg                                                              r_sign2,
    output reg                                              [SINE_BITS+4:0] r_base2,     // [0,17,6]
    output reg         [SINE_BITS-SINE_ADDRESS_BITS+SINE_FRACTION_BITS+5:0] r_product,   // [0,8,16]
    output reg  signed                                      [SINE_BITS-1:0] r_y          // [1,0,17]
);

    localparam PLACE = SINE_ADDRESS_BITS + SINE_FRACTION_BITS;
    localparam SLOPE = SINE_BITS - SINE_ADDRESS_BITS + 5;
    localparam PRODUCT = SLOPE + SINE_FRACTION_BITS + 1;
    localparam DROPPED = SINE_FRACTION_BITS + 6;
    localparam SUM = SINE_BITS + DROPPED;

    reg [SINE_BITS+SLOPE+4:0] rom [0:(1<<SINE_ADDRESS_BITS)-1];
    initial $readmemh(ROM_FILE, rom);

    // the mirror is a plain complement because f is taken at the middle of its cell
    wire [PLACE-1:0] kept = phase[DDS_BITS-3:DDS_BITS-2-PLACE];
    wire [PLACE-1:0] place = phase[DDS_BITS-2] ? ~kept : kept;
    wire [SINE_BITS+SLOPE+4:0] row = rom[place[PLACE-1:SINE_FRACTION_BITS]];

    // f + 1/2 as one odd number of one bit more
    wire [SINE_FRACTION_BITS:0] middle = {r_fraction, 1'b1};
    wire [PRODUCT-1:0] product = {{SINE_FRACTION_BITS+1{1'b0}}, r_slope} * {{SLOPE{1'b0}}, middle};

    // base on the fraction bits of the product. The top bit of the sum stays 0: y has full scale.
    localparam [SUM-1:0] HALF = {{SINE_BITS{1'b0}}, 1'b1, {DROPPED-1{1'b0}}};
    wire [SUM-1:0] scaled = {1'b0, r_base2, {SINE_FRACTION_BITS{1'b0}}};
    wire [SUM-1:0] sum = scaled + {{SINE_ADDRESS_BITS{1'b0}}, r_product} + HALF;
    wire signed [SINE_BITS-1:0] magnitude = sum[SUM-1:DROPPED];
    /* verilator lint_off UNUSED */        // waived: what rounding drops
    wire [DROPPED-1:0] dropped = sum[DROPPED-1:0];
    /* verilator lint_on UNUSED */

    always @(posedge clk) begin
        if (rst) begin
            r_sign     <= 1'b0;
            r_base     <= {SINE_BITS+5{1'b0}};
            r_slope    <= {SLOPE{1'b0}};
            r_fraction <= {SINE_FRACTION_BITS{1'b0}};
            r_sign2    <= 1'b0;
            r_base2    <= {SINE_BITS+5{1'b0}};
            r_product  <= {PRODUCT{1'b0}};
            r_y        <= {SINE_BITS{1'b0}};
        end else begin
            r_sign     <= phase[DDS_BITS-1];
            r_base     <= row[SINE_BITS+SLOPE+4:SLOPE];
            r_slope    <= row[SLOPE-1:0];
            r_fraction <= place[SINE_FRACTION_BITS-1:0];
            r_sign2    <= r_sign;
            r_base2    <= r_base;
            r_product  <= product;
            r_y        <= r_sign2 ? -magnitude : magnitude;
        end
    end

endmodule
