// SPI master for the ADC: a frame per conversion, a status word and ADC_CHANNELS words, of ADC_WORD_BITS bits each.
// A fall of DRDY_N, seen after two synchronising registers, starts it; SCLK is clk / ADC_DIVIDER; DOUT is taken at its
// falls. Latency: 3 + ADC_DIVIDER (1 + ADC_CHANNELS) ADC_WORD_BITS = 435 clocks from the first edge that sees DRDY_N
// low to the one that sees valid = 1. r_ok: whether the status word began with 1100. CS_N rises ADC_TAIL_CLOCKS after
// the last SCLK fall. Words are left justified in 24 bits; channels that are not read stay 0.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_spi_adc #(
    parameter ADC_DIVIDER = 2,       // 2, 4 or 8 clocks to a bit
    parameter ADC_WORD_BITS = 24,    // 16 .. 24
    parameter ADC_CHANNELS = 8,      // 5 .. 8
    parameter ADC_TAIL_CLOCKS = 54
) (
    input  wire               clk,
    input  wire               rst,     // synchronous, active high
    input  wire               drdy_n,
    input  wire               dout,
    output reg                r_meta,
    output reg                r_sync,
    output reg                r_seen,
    output reg                r_busy,
    output reg         [$clog2(ADC_DIVIDER/2*ADC_WORD_BITS|ADC_TAIL_CLOCKS)-1:0] r_count, // [0,6,0]
    output reg                r_cs_n,
    output reg                r_sclk,
    output reg         [23:0] r_shift, // [0,24,0]
    output reg         [3:0]  r_word,  // [0,4,0] 0 status, 1 .. 8 channels, 9 tail
    output reg         [23:0] r_status,
    output reg  signed [23:0] r_channels_0, // [1,23,0]
    output reg  signed [23:0] r_channels_1,
    output reg  signed [23:0] r_channels_2,
    output reg  signed [23:0] r_channels_3,
    output reg  signed [23:0] r_channels_4,
    output reg  signed [23:0] r_channels_5,
    output reg  signed [23:0] r_channels_6,
    output reg  signed [23:0] r_channels_7,
    output reg                r_valid,
    output reg                r_ok
);

    localparam COUNT = $clog2(ADC_DIVIDER/2*ADC_WORD_BITS|ADC_TAIL_CLOCKS);
    localparam HALF = ADC_DIVIDER / 2;
    localparam [31:0] CLOCKS = HALF * ADC_WORD_BITS, BELOW = HALF - 1, TAIL_CLOCKS = ADC_TAIL_CLOCKS;
    localparam [3:0] HEAD = 4'b1100, LAST_WORD = ADC_CHANNELS[3:0], TAIL = LAST_WORD + 4'd1;
    localparam [COUNT-1:0] ONE = {{COUNT-1{1'b0}}, 1'b1}, LOW = BELOW[COUNT-1:0];
    localparam [COUNT-1:0] LAST_CLOCK = CLOCKS[COUNT-1:0] - ONE, LAST_OF_TAIL = TAIL_CLOCKS[COUNT-1:0] - ONE;

    // r_count: HALF times the bit of a word, and the clocks of the half period below it; in the tail its clocks
    wire [COUNT-1:0] next = r_count + ONE;
    wire half_ends = (next & LOW) == {COUNT{1'b0}};
    wire [23:0] bit_at = {23'd0, dout} << (24 - ADC_WORD_BITS);
    wire [23:0] shifted = {r_shift[22:0], 1'b0} | bit_at;

    always @(posedge clk) begin
        if (rst) begin
            r_meta       <= 1'b0;
            r_sync       <= 1'b0;
            r_seen       <= 1'b0;
            r_busy       <= 1'b0;
            r_count      <= {COUNT{1'b0}};
            r_cs_n       <= 1'b1;
            r_sclk       <= 1'b0;
            r_shift      <= 24'd0;
            r_word       <= 4'd0;
            r_status     <= 24'd0;
            r_channels_0 <= 24'sd0;
            r_channels_1 <= 24'sd0;
            r_channels_2 <= 24'sd0;
            r_channels_3 <= 24'sd0;
            r_channels_4 <= 24'sd0;
            r_channels_5 <= 24'sd0;
            r_channels_6 <= 24'sd0;
            r_channels_7 <= 24'sd0;
            r_valid      <= 1'b0;
            r_ok         <= 1'b0;
        end else begin
            r_meta  <= drdy_n;
            r_sync  <= r_meta;
            r_seen  <= r_sync;
            r_valid <= 1'b0;
            if (r_busy) begin
                if (r_word == TAIL) begin
                    r_count <= next;
                    if (r_count == LAST_OF_TAIL) begin
                        r_busy  <= 1'b0;
                        r_count <= {COUNT{1'b0}};
                        r_cs_n  <= 1'b1;
                        r_word  <= 4'd0;
                    end
                end else if (!r_sclk) begin
                    r_count <= (r_count & ~LOW) | (next & LOW);
                    r_sclk  <= half_ends;
                end else begin
                    r_count <= next;
                    if (half_ends) begin
                        r_sclk  <= 1'b0;
                        r_shift <= shifted;
                    end
                    if (r_count == LAST_CLOCK) begin
                        r_count <= {COUNT{1'b0}};
                        r_word  <= r_word + 4'd1;
                        case (r_word)
                            4'd0: r_status     <= shifted;
                            4'd1: r_channels_0 <= shifted;
                            4'd2: r_channels_1 <= shifted;
                            4'd3: r_channels_2 <= shifted;
                            4'd4: r_channels_3 <= shifted;
                            4'd5: r_channels_4 <= shifted;
                            4'd6: r_channels_5 <= shifted;
                            4'd7: r_channels_6 <= shifted;
                            default: r_channels_7 <= shifted;
                        endcase
                        if (r_word == LAST_WORD) begin
                            r_valid <= 1'b1;
                            r_ok    <= (r_status[23:20] == HEAD);
                        end
                    end
                end
            end else if (r_seen && !r_sync) begin
                r_busy <= 1'b1;
                r_cs_n <= 1'b0;
            end
        end
    end

endmodule
