// Serial link of a DAC: a counter of clocks since the load says what every line does, a second one which bit it is.
module dac_link #(
    parameter NBITS = 24, parameter T_LEAD = 0, parameter HAS_LDAC = 0,
    parameter DIV = 0, parameter PRE_STROBE = 0
) (
    input  wire        clk_26, arst_n, go,
    input  wire [23:0] tx_word,
    output reg         cs_b, sck_gate, ldac_b, mosi
);
    localparam LAST = T_LEAD + NBITS * (DIV + 1);   // first clock behind the frame
    localparam IDLE = LAST + 2;

    // clocks of a frame in which SCLK is let through
    function [255:0] gates(input integer step);
        integer k;
        for (k = 0; k < 256; k = k + 1)
            gates[k] = k >= T_LEAD && k < LAST && (k - T_LEAD) % step == 0;
    endfunction
    localparam [255:0] GATES = gates(DIV + 1);

    reg  [7:0]  slot;
    reg  [4:0]  index;                              // 31: no bit
    reg  [23:0] hold;
    wire [7:0]  ahead = go ? 8'd0 : (slot == IDLE) ? slot : slot + 8'd1;
    wire [4:0]  bit_n = go ? NBITS - 5'd1 : index - sck_gate;
    wire [31:0] data  = {8'd0, go ? tx_word : hold};
    always @(posedge clk_26 or negedge arst_n)
        if (!arst_n) begin
            slot  <= IDLE;
            index <= 5'd31;
            {cs_b, sck_gate, ldac_b, mosi} <= 4'b1010;
        end else begin
            slot     <= ahead;
            index    <= bit_n;
            hold     <= data[23:0];
            cs_b     <= ahead >= LAST;
            sck_gate <= GATES[ahead];
            ldac_b   <= !(HAS_LDAC != 0 && ahead == LAST + 1) && !(PRE_STROBE != 0 && ahead == 0);
            mosi     <= data[bit_n];
        end
endmodule
