// Framing of gyro_spi_adc: 216 clocks of SCLK between a fall of CS_N and its rise, data of the right clocks in each word.
//   falls, rises   of SCLK since CS_N fell
//   taken          the last 24 bits of DOUT at falls of SCLK
module prove_spi_adc (
    input wire clk,
    input wire rst,
    input wire dout,
    input wire r_sync,
    input wire r_seen,
    input wire r_busy,
    input wire [5:0] r_count,
    input wire r_cs_n,
    input wire r_sclk,
    input wire [23:0] r_shift,
    input wire [3:0] r_word,
    input wire [23:0] r_status,
    input wire signed [23:0] r_channels_7,
    input wire r_valid,
    input wire r_ok
);

    localparam [3:0] WORDS = 4'd9;
    localparam [7:0] BITS = 8'd216;

    reg begun = 1'b0;
    reg was_rst, was_cs_n, was_sclk, was_valid, was_fall, was_ready;
    reg [7:0] falls, rises;
    reg [23:0] taken, first;
    reg [3:0] was_word;
    always @(posedge clk) begin
        begun     <= 1'b1;
        was_rst   <= rst;
        was_cs_n  <= r_cs_n;
        was_sclk  <= r_sclk;
        was_valid <= r_valid;
        was_ready <= r_seen && !r_sync;
        was_word  <= r_word;
        if (rst || r_cs_n) begin
            falls <= 8'd0;
            rises <= 8'd0;
        end else if (r_word != WORDS) begin
            falls <= falls + {7'd0, r_sclk};
            rises <= rises + {7'd0, !r_sclk};
        end
        if (rst)
            taken <= 24'd0;
        else if (r_sclk)
            taken <= {taken[22:0], dout};
    end

    wire [7:0] due = {4'd0, r_word} * 8'd24 + {2'd0, r_count};

    always @* begin
        if (!begun)
            assume (rst);
        else begin
            busy_is_selected: assert (r_busy == !r_cs_n);
            clock_only_selected: assert (!r_sclk || !r_cs_n);
            idle_is_clear: assert (r_busy || (r_word == 4'd0 && r_count == 6'd0));
            words_are_nine: assert (r_word <= WORDS);
            word_of_24: assert (r_word == WORDS ? (r_count <= 6'd53 && !r_sclk) : r_count <= 6'd23);
            falls_add_up: assert (r_cs_n || falls == (r_word == WORDS ? BITS : due));
            rises_add_up: assert (r_cs_n || rises == falls + {7'd0, r_sclk});
            begins_with_ready: assert (was_rst || !was_cs_n || r_cs_n || was_ready);
            ends_complete: assert (was_rst || was_cs_n || !r_cs_n || was_word == WORDS);
            valid_is_complete: assert (!r_valid || (r_word == WORDS && falls == BITS && r_count == 6'd0));
            valid_one_clock: assert (!r_valid || !was_valid);
            valid_comes: assert (was_rst || !(r_word == WORDS && was_word != WORDS) || r_valid);
            bits_of_the_falls: assert (r_shift == taken);
            last_channel: assert (!r_valid || r_channels_7 == taken);
            judged_by_head: assert (!r_valid || r_ok == (r_status[23:20] == 4'b1100));
        end
    end

endmodule
