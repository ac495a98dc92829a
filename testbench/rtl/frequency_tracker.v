// Drive frequency loop: a PI on the phase moves the DDS word around a centre, which load sets and adjust corrects.
//   en: error = phase; centre = preset if load, else centre + correction if adjust;   every clock: word = centre + y
// Latency: 4 clocks from en to r_word when en_pi follows en by one clock.   Rounding: as gyro_pi.
// Overflow: r_loop_y saturates at loop_lo and loop_hi; centre and word wrap at one turn per clock.
// Formats are those of the default design.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_frequency_tracker #(
    parameter        [31:0] MASTER_HZ = 32'd26000000,  // clk
    parameter               DDS_BITS  = 48,            // width of a word
    parameter ACCUMULATOR_FRACTION_BITS = 24,          // of the PI
    parameter signed [33:0] loop_kp   = 34'sd0,        // [1,9,24]
    parameter signed [33:0] loop_ki   = 34'sd0,        // [1,9,24]
    parameter signed [35:0] loop_lo   = 36'sd0,        // [1,35,0]
    parameter signed [35:0] loop_hi   = 36'sd0         // [1,35,0]
) (
    input  wire                                         clk,
    input  wire                                         rst,          // synchronous, active high
    input  wire                                         en,
    input  wire                                         en_pi,
    input  wire                                   [1:0] mode,
    input  wire signed                           [23:0] phase,        // [1,-1,24] turns
    input  wire                                         load,
    input  wire                                         adjust,
    input  wire signed                   [DDS_BITS-1:0] correction,   // [1,-1,48] turns per clock
    input  wire                          [DDS_BITS-1:0] preset,       // [0,0,48] turns per clock
    output reg  signed                           [23:0] r_error,      // [1,-1,24] turns
    output reg                           [DDS_BITS-1:0] r_centre,     // [0,0,48] turns per clock
    output reg                           [DDS_BITS-1:0] r_word,       // [0,0,48] turns per clock
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_loop_prop,  // [1,35,24]
    output wire signed [ACCUMULATOR_FRACTION_BITS+35:0] r_loop_acc,   // [1,35,24]
    output wire signed                           [35:0] r_loop_y      // [1,35,0]
);

    // 11 kHz in turns per clock, rounded
    localparam [63:0] TWICE = (64'd11000 << (DDS_BITS + 1)) / {32'd0, MASTER_HZ} + 64'd1;
    localparam [DDS_BITS-1:0] NOMINAL_WORD = TWICE[DDS_BITS:1];

    wire signed [25:0] loop_e = {{2{r_error[23]}}, r_error};

    gyro_pi #(
        .ACCUMULATOR_FRACTION_BITS(ACCUMULATOR_FRACTION_BITS),
        .kp(loop_kp), .ki(loop_ki), .lo(loop_lo), .hi(loop_hi)
    ) loop (
        .clk(clk), .rst(rst), .en(en_pi), .mode(mode), .e(loop_e), .preset(36'sd0),
        .r_prop(r_loop_prop), .r_acc(r_loop_acc), .r_y(r_loop_y)
    );

    /* verilator lint_off UNUSED */ // waived: a narrow word takes the low bits
    wire [47:0] wide_y = {{12{r_loop_y[35]}}, r_loop_y};
    /* verilator lint_on UNUSED */

    always @(posedge clk) begin
        if (rst) begin
            r_error  <= 24'sd0;
            r_centre <= NOMINAL_WORD;
            r_word   <= NOMINAL_WORD;
        end else begin
            r_word <= r_centre + wide_y[DDS_BITS-1:0];
            if (en) begin
                r_error <= phase;
                if (load)
                    r_centre <= preset;
                else if (adjust)
                    r_centre <= r_centre + correction;
            end
        end
    end

endmodule
