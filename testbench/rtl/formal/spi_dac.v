// Framing of gyro_spi_dac: each frame that nothing interrupts has its number of bits, MSB first, then LDAC.
//   sent, count   bits that have gone out since SYNC fell, as the part clocks them in, and how many
//   given         the word of the frame
module prove_spi_dac #(
    parameter [4:0] bits = 5'd0,
    parameter [1:0] lead = 2'd0,
    parameter ldac = 1'd0,
    parameter [1:0] gap = 2'd0,
    parameter strobe = 1'd0
) (
    input wire clk,
    input wire rst,
    input wire load,
    input wire [23:0] word,
    input wire [23:0] r_shift,
    input wire [4:0] r_left,
    input wire [1:0] r_lead,
    input wire r_sync_n,
    input wire r_sclk_en,
    input wire r_ldac_n,
    input wire r_ldac_wait,
    input wire o_sdin
);

    localparam [23:0] MASK = (24'd1 << bits) - 24'd1;

    reg begun = 1'b0;
    reg was_rst, was_load, was_sync_n, was_ldac_n, was_wait;
    reg [23:0] given, sent;
    reg [4:0] count;
    always @(posedge clk) begin
        begun      <= 1'b1;
        was_rst    <= rst;
        was_load   <= load;
        was_sync_n <= r_sync_n;
        was_ldac_n <= r_ldac_n;
        was_wait   <= r_ldac_wait;
        if (load) begin
            given <= word;
            sent  <= 24'd0;
            count <= 5'd0;
        end else if (r_sclk_en) begin
            sent  <= {sent[22:0], o_sdin};
            count <= count + 5'd1;
        end
    end

    wire ended = was_sync_n == 1'b0 && r_sync_n == 1'b1 && !was_rst;

    always @* begin
        if (!begun)
            assume (rst);
        else begin
            clock_only_in_frame: assert (!r_sclk_en || !r_sync_n);
            loads_in_frame: assert (was_rst || !was_load || !r_sync_n);
            bits_add_up: assert (r_sync_n || count + r_left == bits);
            never_too_many: assert (r_sync_n || ((r_left != 5'd0 || r_lead != 2'd0) && r_left <= bits));
            leads_then_clocks: assert (r_sync_n || r_sclk_en == (r_lead == 2'd0));
            no_bit_in_the_lead: assert (r_lead == 2'd0 || r_lead <= (count == 5'd0 ? lead : gap) || r_sync_n);
            rest_to_come: assert (r_sync_n || (r_shift & MASK) == ((given << count) & MASK));
            gone_is_the_head: assert (r_sync_n || sent == ((given & MASK) >> r_left));
            frame_is_the_word: assert (!ended || (count == bits && sent == (given & MASK)));
            ldac_outside_frames: assert (r_ldac_n || r_sync_n || (strobe == 1'b1 && was_load));
            ldac_one_clock: assert (r_ldac_n || was_ldac_n || was_load);
            ldac_after_frame: assert (!(ended && ldac == 1'b1) || r_ldac_wait);
            waits_one_clock: assert (!r_ldac_wait || (ended && ldac == 1'b1));
            ldac_follows: assert (was_rst || (was_load ? r_ldac_n == !strobe : r_ldac_n == !was_wait));
        end
    end

endmodule
