// Sine from a quarter-wave table with linear interpolation.
//   y = +-round(base[a] + slope[a] * (f + 1/2) / 1024); a, f complemented in odd quadrants, minus in quadrants 2 and 3
// Latency: 3 clocks from phase to y.   Rounding: magnitude, ties up.   No overflow: the table tops out at 2**17 - 1.
// ROM_FILE: 1024 hex words of 36 bits, base [0,17,6] above slope [0,8,5]; no default that could hide a missing table.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_sine #(
    parameter ROM_FILE = ""
) (
    input  wire               clk,
    input  wire               rst,         // synchronous, active high
    /* verilator lint_off UNUSED */        // waived: the lower 26 bits of the phase are cut
    input  wire        [47:0] phase,       // [0,0,48] turns
    /* verilator lint_on UNUSED */
    output reg                r_sign,
    output reg         [22:0] r_base,      // [0,17,6]
    output reg         [12:0] r_slope,     // [0,8,5]
    output reg          [9:0] r_fraction,  // [0,0,10]
    output reg                r_sign2,
    output reg         [22:0] r_base2,     // [0,17,6]
    output reg         [23:0] r_product,   // [0,8,16]
    output reg  signed [17:0] r_y          // [1,0,17]
);

    reg [35:0] rom [0:1023];
    initial $readmemh(ROM_FILE, rom);

    // the mirror is a plain complement because f is taken at the middle of its cell
    wire [19:0] place = phase[46] ? ~phase[45:26] : phase[45:26];
    wire [35:0] row = rom[place[19:10]];

    // (f + 1/2) / 1024 as one odd number of 11 bits
    wire [10:0] middle = {r_fraction, 1'b1};
    wire [23:0] product = {11'd0, r_slope} * {13'd0, middle};

    // base on the 16 fraction bits of the product; half is 2**15. Bit 33 stays 0: full scale is 2**17 - 1.
    wire [33:0] sum = {1'b0, r_base2, 10'd0} + {10'd0, r_product} + 34'd32768;
    wire signed [17:0] magnitude = sum[33:16];
    /* verilator lint_off UNUSED */        // waived: what rounding drops
    wire [15:0] dropped = sum[15:0];
    /* verilator lint_on UNUSED */

    always @(posedge clk) begin
        if (rst) begin
            r_sign     <= 1'b0;
            r_base     <= 23'd0;
            r_slope    <= 13'd0;
            r_fraction <= 10'd0;
            r_sign2    <= 1'b0;
            r_base2    <= 23'd0;
            r_product  <= 24'd0;
            r_y        <= 18'sd0;
        end else begin
            r_sign     <= phase[47];
            r_base     <= row[35:13];
            r_slope    <= row[12:0];
            r_fraction <= place[9:0];
            r_sign2    <= r_sign;
            r_base2    <= r_base;
            r_product  <= product;
            r_y        <= r_sign2 ? -magnitude : magnitude;
        end
    end

endmodule
