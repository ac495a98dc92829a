// DDS of four phases with a register behind its adders for timing: one clock later than the bundle, registers not reset
module dds_piped (
    input  wire        clk,
    input  wire        srst,
    input  wire [47:0] increment,
    input  wire [191:0] offsets,   // drive sine, sense sine, drive reference, sense reference from the left
    output wire [191:0] phases
);
    reg [47:0] phase;
    reg [191:0] sums, out;
    assign phases = out;
    always @(posedge clk) begin
        phase <= srst ? 48'd0 : phase + increment;
        sums <= srst ? 192'd0 : {phase + offsets[191:144], phase + offsets[143:96], phase + offsets[95:48],
                                 phase + offsets[47:0]};
        out <= sums;
    end
endmodule
