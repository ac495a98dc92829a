// Frames of gyro_spi_slave: only one of the right length, CRC and command writes or is done; each other one is flagged.
//   count, taken   bits since CS_N fell, and the last 40 of them
//   command, sum   the first 16, and the CRC over these and the words
module prove_spi_slave (
    input wire clk,
    input wire rst,
    input wire [31:0] rdata,
    input wire [2:0] clear,
    input wire r_cs_n,
    input wire r_active,
    input wire r_sck,
    input wire r_sck_seen,
    input wire r_sdi,
    input wire [2:0] r_phase,
    input wire [4:0] r_bit,
    input wire [2:0] r_words,
    input wire r_read,
    input wire [10:0] r_address,
    input wire [7:0] r_crc,
    input wire [39:0] r_shift,
    input wire [31:0] r_data,
    input wire r_second,
    input wire r_spoiled,
    input wire r_refused,
    input wire r_write,
    input wire r_done,
    input wire [2:0] r_errors,
    input wire o_sdo,
    input wire o_fetch,
    input wire o_start
);

    reg begun = 1'b0;
    reg was_rst, was_write, was_second, was_rise, was_fetch, was_active, was_cs_n;
    reg [2:0] was_clear, was_errors;
    reg [31:0] was_rdata, first, last;
    reg [39:0] was_shift, taken;
    reg [9:0] count;
    reg [15:0] command;
    reg [7:0] sum;
    reg right, empty, exact, ended, was_spoiled;

    wire rise = !r_cs_n && r_sck && !r_sck_seen;
    wire reads = command[15];
    wire [2:0] asked = command[14:12];
    wire [2:0] length = asked == 3'd0 ? 3'd1 : asked;
    wire [9:0] head = reads ? 10'd24 : 10'd16;
    wire [9:0] tail = head + {2'd0, length, 5'd0};
    wire heard = count >= 10'd16;
    wire covered = !heard || (count >= head && count < tail);
    wire bit_of = heard && reads ? o_sdo : r_sdi;
    wire allowed = asked != 3'd0 && (reads || asked <= 3'd2) && !command[11] && command[1:0] == 2'd0;
    wire [2:0] gone = length - (r_words == 3'd0 ? 3'd1 : r_words);
    wire [9:0] before = r_phase == 3'd0 ? 10'd0 : r_phase == 3'd1 ? 10'd16
        : r_phase == 3'd2 ? head + {2'd0, gone, 5'd0} : r_phase == 3'd3 ? tail : tail + 10'd8;
    wire follows = was_write && was_second;
    wire [39:0] own = count >= 10'd40 ? 40'hFFFFFFFFFF : (40'd1 << count) - 40'd1;

    always @(posedge clk) begin
        begun       <= 1'b1;
        was_rst     <= rst;
        was_write   <= r_write;
        was_second  <= r_second;
        was_rise    <= rise;
        was_fetch   <= o_fetch;
        was_active  <= r_active;
        was_cs_n    <= r_cs_n;
        was_clear   <= clear;
        was_errors  <= r_errors;
        was_rdata   <= rdata;
        was_shift   <= r_shift;
        ended       <= r_cs_n && r_active && !rst;
        empty       <= count == 10'd0;
        if (r_cs_n && r_active)
            last <= taken[39:8];
        exact       <= heard && count == tail + 10'd8;
        right       <= heard && count == tail + 10'd8 && allowed && !r_spoiled;
        was_spoiled <= r_spoiled;
        if (rst || r_cs_n) begin
            count <= 10'd0;
            sum   <= 8'hFF;
        end else if (rise) begin
            if (count < 10'd1000)
                count <= count + 10'd1;
            taken <= {taken[38:0], r_sdi};
            if (count == 10'd15)
                command <= {taken[14:0], r_sdi};
            if (count == 10'd47)
                first <= {taken[30:0], r_sdi};
            if (covered)
                sum <= {sum[6:0], 1'b0} ^ (sum[7] != bit_of ? 8'h1D : 8'h00);
        end
    end

    always @* begin
        if (!begun)
            assume (rst);
        else begin
            phases_exist: assert (r_phase <= 3'd5);
            idle_is_clear: assert (r_active || (r_phase == 3'd0 && r_bit == 5'd0 && !r_spoiled && !r_refused));
            command_is_short: assert (r_phase != 3'd0 || (r_bit <= 5'd15 && !heard && !r_spoiled && !r_refused));
            checks_are_bytes: assert ((r_phase != 3'd1 && r_phase != 3'd3) || r_bit <= 5'd7);
            only_reads_check_the_command: assert (r_phase != 3'd1 || r_read);
            complete_waits: assert (r_phase != 3'd4 || r_bit == 5'd0);
            bits_add_up: assert (r_phase == 3'd5 || count == before + {5'd0, r_bit});
            too_long_is_longer: assert (r_phase != 3'd5 || count > tail + 10'd8);
            words_remain: assert (r_phase == 3'd0 || (r_words <= asked && (r_words != 3'd0 || asked == 3'd0)));
            words_as_asked: assert (r_phase != 3'd1 || r_words == asked);
            last_word_is_one: assert (r_phase <= 3'd2 || r_words <= 3'd1);
            reads_as_asked: assert (r_phase == 3'd0 || (heard && r_read == reads));
            refused_as_asked: assert (r_phase == 3'd0 || r_refused == !allowed);
            crc_of_command_and_words: assert (r_crc == sum || r_phase == 3'd5);
            bits_are_kept: assert (r_phase == 3'd5 || (reads && r_phase >= 3'd2) || ((r_shift ^ taken) & own) == 40'd0);
            spoiled_by_the_crc: assert (r_phase != 3'd4 || r_read || r_spoiled == (taken[7:0] != ~sum));
            second_follows: assert (r_phase == 3'd0 || r_second == (!reads && gone != 3'd0));
            second_is_written: assert (r_phase != 3'd0 || !r_second || r_write);
            first_is_kept: assert (r_phase == 3'd0 || !r_second || asked != 3'd2 || r_data == first);
            address_is_kept: assert (r_phase == 3'd0 || reads || r_address == command[10:0]);
            writes_between_frames: assert (!r_write || count <= 10'd1);
            data_is_the_word: assert (!r_write || r_data == (r_second ? first : last));
            data_has_its_address: assert (!r_write || r_address == command[10:0] + (follows ? 11'd4 : 11'd0));
            ends_once: assert (!ended || !r_active);
            right_is_written: assert (follows || r_write == (ended && right && !reads));
            right_is_done: assert (was_rst || r_done == (ended && right && reads));
            never_both: assert (!r_write || !r_done);
            wrong_is_flagged: assert (!ended || right || empty
                || (exact ? (was_spoiled ? r_errors[0] : r_errors[2]) : r_errors[1]));
            empty_is_nothing: assert (!(ended && empty) || (r_errors & ~was_errors) == 3'd0);
            flags_stay: assert (was_rst || (was_errors & ~was_clear & ~r_errors) == 3'd0);
            fetched: assert (was_rst || !was_fetch || r_shift == {was_rdata, 8'd0});
            out_moves_with_sck: assert (was_rst || was_rise || !was_active || r_shift == was_shift);
            out_is_the_top: assert (o_sdo == r_shift[39]);
            start_once: assert (!o_start || (!r_cs_n && !r_active));
        end
    end

endmodule
