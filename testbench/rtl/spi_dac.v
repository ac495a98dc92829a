// SPI master for the DACs: a bit every gap + 1 clocks, MSB first; SCLK is clk gated by r_sclk_en, SDIN the MSB of the
// register. r_lead counts the clocks before the first bit and those between bits.
// Latency: lead + bits (gap + 1) + ldac clocks from the load edge to the edge that changes the DAC's output.
// A load restarts a frame in progress. The word comes ready: flip, header, control, data_mask and tail, of which it is
// built, are parameters of the frame and kept here so that the list is that of the block.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_spi_dac #(
    parameter [4:0]  bits      = 5'd24,  // of a frame
    parameter [1:0]  lead      = 2'd0,   // clocks between SYNC low and the first SCLK
    parameter [0:0]  ldac      = 1'b0,   // 1: the part wants an LDAC pulse
    /* verilator lint_off UNUSED */      // waived: see above
    parameter [19:0] flip      = 20'd0,
    parameter [23:0] header    = 24'd0,
    parameter [23:0] control   = 24'd0,
    parameter [19:0] data_mask = 20'd0,
    parameter [3:0]  tail      = 4'd0,
    /* verilator lint_on UNUSED */
    parameter [1:0]  gap       = 2'd0,   // clocks without SCLK behind each bit
    parameter [0:0]  strobe    = 1'b0    // 1: LDAC falls with the next load
) (
    input  wire        clk,
    input  wire        rst,              // synchronous, active high
    input  wire        load,
    input  wire [23:0] word,             // [0,24,0]
    output reg  [23:0] r_shift,          // [0,24,0]
    output reg   [4:0] r_left,           // [0,5,0]
    output reg   [1:0] r_lead,           // [0,2,0]
    output reg         r_sync_n,
    output reg         r_sclk_en,
    output reg         r_ldac_n,
    output reg         r_ldac_wait,
    output wire        o_sdin
);

    localparam [23:0] MASK = (24'd1 << bits) - 24'd1;
    localparam [23:0] MSB = 24'd1 << (bits - 5'd1);

    assign o_sdin = |(r_shift & MSB);

    // the last clock of the last bit
    wire ends = r_sclk_en ? gap == 2'd0 && (r_left == 5'd1) : r_lead == 2'd1 && r_left == 5'd0;

    always @(posedge clk) begin
        if (rst) begin
            r_shift     <= 24'd0;
            r_left      <= 5'd0;
            r_lead      <= 2'd0;
            r_sync_n    <= 1'b1;
            r_sclk_en   <= 1'b0;
            r_ldac_n    <= 1'b1;
            r_ldac_wait <= 1'b0;
        end else if (load) begin
            r_shift     <= word;
            r_left      <= bits;
            r_lead      <= lead;
            r_sync_n    <= 1'b0;
            r_sclk_en   <= (lead == 2'd0);
            r_ldac_n    <= ~strobe;
            r_ldac_wait <= 1'b0;
        end else begin
            // LDAC falls one clock after SYNC has risen, for one clock
            r_ldac_n    <= ~r_ldac_wait;
            r_ldac_wait <= 1'b0;
            if (r_sclk_en) begin
                r_shift <= {r_shift[22:0], 1'b0} & MASK;
                r_left  <= r_left - 5'd1;
                r_lead  <= gap;
                if (gap != 2'd0)
                    r_sclk_en <= 1'b0;
            end else if (r_lead != 2'd0) begin
                r_lead    <= r_lead - 2'd1;
                r_sclk_en <= (r_lead == 2'd1);
            end
            if (ends) begin
                r_sync_n    <= 1'b1;
                r_sclk_en   <= 1'b0;
                r_ldac_wait <= ldac;
            end
        end
    end

endmodule
