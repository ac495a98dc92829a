// One phase accumulator and four outputs with a phase offset each.
//   phase[n+1] = phase[n] + word,  output[n+1] = phase[n] + offset   (mod 1 turn)
// Formats: all [0,0,DDS_BITS], unsigned turns.   Latency: 1 clock, word to phase and phase to output.
// Reset 0. Every sum wraps on purpose: phase arithmetic is modular.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_dds #(
    parameter DDS_BITS = 48  // width of the phase, 24 .. 48
) (
    input  wire                clk,
    input  wire                rst,             // synchronous, active high
    input  wire [DDS_BITS-1:0] word,            // [0,0,DDS_BITS] turns per clock
    input  wire [DDS_BITS-1:0] off_drive_sine,  // [0,0,DDS_BITS] positive advances
    input  wire [DDS_BITS-1:0] off_sense_sine,
    input  wire [DDS_BITS-1:0] off_drive_ref,
    input  wire [DDS_BITS-1:0] off_sense_ref,
    output reg  [DDS_BITS-1:0] r_phase,         // [0,0,DDS_BITS]
    output reg  [DDS_BITS-1:0] r_drive_sine,
    output reg  [DDS_BITS-1:0] r_sense_sine,
    output reg  [DDS_BITS-1:0] r_drive_ref,
    output reg  [DDS_BITS-1:0] r_sense_ref
);

    always @(posedge clk) begin
        if (rst) begin
            r_phase      <= {DDS_BITS{1'b0}};
            r_drive_sine <= {DDS_BITS{1'b0}};
            r_sense_sine <= {DDS_BITS{1'b0}};
            r_drive_ref  <= {DDS_BITS{1'b0}};
            r_sense_ref  <= {DDS_BITS{1'b0}};
        end else begin
            r_phase      <= r_phase + word;
            r_drive_sine <= r_phase + off_drive_sine;
            r_sense_sine <= r_phase + off_sense_sine;
            r_drive_ref  <= r_phase + off_drive_ref;
            r_sense_ref  <= r_phase + off_sense_ref;
        end
    end

endmodule
