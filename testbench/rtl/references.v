// The four reference pins sgn(sin), sgn(cos) of drive and sense, optionally held on the 1 MHz grid.
//   bit 0 drive sgn(sin), bit 1 drive sgn(cos), bit 2 sense sgn(sin), bit 3 sense sgn(cos)
// Latency: 1 + align clocks from a phase to its pin; retimed: 1 more, after waiting for ce_1m.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_references #(
    parameter       DDS_BITS = 48,    // width of a phase
    parameter [1:0] align    = 2'd0,  // further registers, 0 .. 3
    parameter [0:0] retimed  = 1'b0   // 1: pins change on the 1 MHz grid only
) (
    input  wire                clk,
    input  wire                rst,          // synchronous, active high
    /* verilator lint_off UNUSED */          // waived: a sign needs the two top bits of a phase only
    input  wire [DDS_BITS-1:0] drive_ref,    // [0,0,DDS_BITS] turns
    input  wire [DDS_BITS-1:0] sense_ref,    // [0,0,DDS_BITS] turns
    /* verilator lint_on UNUSED */
    input  wire                ce_1m,
    output reg           [3:0] r_signs,      // [0,4,0]
    output reg           [3:0] r_aligned_0,
    output reg           [3:0] r_aligned_1,
    output reg           [3:0] r_aligned_2,
    output reg           [3:0] r_retimed,
    output wire          [3:0] o_pins
);

    // half a turn: sin < 0; the second and the third quarter: cos < 0
    wire [3:0] signs = {~(sense_ref[DDS_BITS-1] ^ sense_ref[DDS_BITS-2]), ~sense_ref[DDS_BITS-1],
                        ~(drive_ref[DDS_BITS-1] ^ drive_ref[DDS_BITS-2]), ~drive_ref[DDS_BITS-1]};

    wire [3:0] picked = (align == 2'd0) ? r_signs :
                        (align == 2'd1) ? r_aligned_0 :
                        (align == 2'd2) ? r_aligned_1 : r_aligned_2;

    assign o_pins = (retimed == 1'b1) ? r_retimed : picked;

    always @(posedge clk) begin
        if (rst) begin
            r_signs     <= 4'd0;
            r_aligned_0 <= 4'd0;
            r_aligned_1 <= 4'd0;
            r_aligned_2 <= 4'd0;
            r_retimed   <= 4'd0;
        end else begin
            r_signs     <= signs;
            r_aligned_0 <= r_signs;
            r_aligned_1 <= r_aligned_0;
            r_aligned_2 <= r_aligned_1;
            if (ce_1m)
                r_retimed <= picked;
        end
    end

endmodule
