// One 48-bit phase accumulator and four outputs with a phase offset each.
//   phase[n+1] = phase[n] + word,  output[n+1] = phase[n] + offset   (mod 1 turn)
// Formats: all [0,0,48], unsigned turns.   Latency: 1 clock, word to phase and phase to output.
// Reset 0. Every sum wraps on purpose: phase arithmetic is modular.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_dds (
    input  wire        clk,
    input  wire        rst,             // synchronous, active high
    input  wire [47:0] word,            // [0,0,48] turns per clock
    input  wire [47:0] off_drive_sine,  // [0,0,48] positive advances
    input  wire [47:0] off_sense_sine,
    input  wire [47:0] off_drive_ref,
    input  wire [47:0] off_sense_ref,
    output reg  [47:0] r_phase,         // [0,0,48]
    output reg  [47:0] r_drive_sine,
    output reg  [47:0] r_sense_sine,
    output reg  [47:0] r_drive_ref,
    output reg  [47:0] r_sense_ref
);

    always @(posedge clk) begin
        if (rst) begin
            r_phase      <= 48'd0;
            r_drive_sine <= 48'd0;
            r_sense_sine <= 48'd0;
            r_drive_ref  <= 48'd0;
            r_sense_ref  <= 48'd0;
        end else begin
            r_phase      <= r_phase + word;
            r_drive_sine <= r_phase + off_drive_sine;
            r_sense_sine <= r_phase + off_sense_sine;
            r_drive_ref  <= r_phase + off_drive_ref;
            r_sense_ref  <= r_phase + off_sense_ref;
        end
    end

endmodule
