// Properties of gyro_dds. `begun` is 0 in the first clock alone, which resets; was_* are values of the clock before.
module prove_dds (
    input wire clk,
    input wire rst,
    input wire [47:0] word,
    input wire [47:0] off_drive_sine,
    input wire [47:0] off_sense_sine,
    input wire [47:0] off_drive_ref,
    input wire [47:0] off_sense_ref,
    input wire [47:0] r_phase,
    input wire [47:0] r_drive_sine,
    input wire [47:0] r_sense_sine,
    input wire [47:0] r_drive_ref,
    input wire [47:0] r_sense_ref
);

    reg begun = 1'b0;
    reg was_rst;
    reg [47:0] was_phase, was_word, was_drive_sine, was_sense_sine, was_drive_ref, was_sense_ref;
    always @(posedge clk) begin
        begun          <= 1'b1;
        was_rst        <= rst;
        was_phase      <= r_phase;
        was_word       <= word;
        was_drive_sine <= off_drive_sine;
        was_sense_sine <= off_sense_sine;
        was_drive_ref  <= off_drive_ref;
        was_sense_ref  <= off_sense_ref;
    end

    wire [47:0] moved = r_phase - was_phase;
    wire [1:0] quarters = r_phase[47:46] - was_phase[47:46];

    always @* begin
        if (!begun)
            assume (rst);
        else if (was_rst)
            resets: assert ({r_phase, r_drive_sine, r_sense_sine, r_drive_ref, r_sense_ref} == 240'd0);
        else begin
            advances_by_word: assert (moved == was_word);
            skips_no_quarter: assert (was_word[47:46] != 2'd0 || quarters <= 2'd1);
            // an output is ahead of another by the difference of their offsets, whatever the r_phase
            sines_apart: assert (r_drive_sine - r_sense_sine == was_drive_sine - was_sense_sine);
            references_apart: assert (r_drive_ref - r_sense_ref == was_drive_ref - was_sense_ref);
            sine_and_reference_apart: assert (r_drive_sine - r_drive_ref == was_drive_sine - was_drive_ref);
        end
    end

endmodule
