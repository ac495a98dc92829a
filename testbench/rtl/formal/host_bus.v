// Bus of gyro_host_bus: a pair of words is written whole or not at all, a sample is read whole, none is lost unseen.
//   opened, opened_of  the last write was the low word of a pair, and of which register
//   arrived, since     samples since the last that was read, and since the last that was taken, to 2
module prove_host_bus #(
    parameter [7:0] pairs = 8'hBC
) (
    input wire clk,
    input wire rst,
    input wire [10:0] address,
    input wire fetch,
    input wire start,
    input wire done,
    input wire write,
    input wire [31:0] data,
    input wire [47:0] value,
    input wire frame,
    input wire valid,
    input wire signed [31:0] rate,
    input wire signed [15:0] temperature,
    input wire [2:0] k,
    input wire [7:0] flags,
    input wire [3:0] state,
    input wire [3:0] lock,
    input wire [15:0] r_high,
    input wire [7:0] r_high_of,
    input wire [31:0] r_low,
    input wire [2:0] r_low_of,
    input wire r_pending,
    input wire r_bank_write,
    input wire [7:0] r_bank_address,
    input wire [47:0] r_bank_data,
    input wire [2:0] r_clear,
    input wire [11:0] r_frames,
    input wire r_fresh,
    input wire signed [31:0] r_rate,
    input wire signed [15:0] r_temperature,
    input wire [18:0] r_status,
    input wire [11:0] r_number,
    input wire signed [15:0] r_held_temperature,
    input wire [20:0] r_held_status,
    input wire [11:0] r_held_number,
    input wire [1:0] r_unread,
    input wire [1:0] r_unread_after,
    input wire r_reading,
    input wire [31:0] o_rdata,
    input wire [4:0] o_bus_status,
    input wire o_data_ready
);

    reg begun = 1'b0;
    reg was_rst, was_write, was_fetch, was_take, was_sample, was_frame, was_valid, was_fresh;
    reg [10:0] was_address;
    reg [31:0] was_data;
    reg [47:0] was_value;
    reg [48:0] was_held;
    reg opened;
    reg [7:0] opened_of;
    reg [31:0] opened_data;

    wire wide = address[10:6] == 5'd0 && pairs[address[5:3]];
    wire take = fetch && address == 11'h280;
    wire sample = frame && (r_fresh || valid);
    wire [82:0] given = {rate, temperature, k, lock, state, flags, r_frames, 4'd0};
    wire [82:0] newest = {r_rate, r_temperature, r_status, r_number, 4'd0};
    reg [82:0] kept_given, kept_newest;
    wire [48:0] held = {r_held_temperature, r_held_status, r_held_number};
    reg [1:0] was_unread, was_after;
    reg was_done, was_reading, was_start, was_opened;
    reg [7:0] was_opened_of;
    reg [31:0] was_opened_data;
    reg [11:0] was_frames;

    wire was_high = was_address[2];
    wire [7:0] was_register = was_address[10:3];
    wire was_pair = was_register[7:3] == 5'd0 && pairs[was_register[2:0]];
    wire [2:0] counted = {1'b0, was_done && was_reading ? was_after : was_unread} + {2'd0, was_sample};
    wire [2:0] counted_after = {1'b0, was_take ? 2'd0 : was_after} + {2'd0, was_sample};

    always @(posedge clk) begin
        begun           <= 1'b1;
        was_rst         <= rst;
        was_write       <= write;
        was_fetch       <= fetch;
        was_take        <= take;
        was_sample      <= sample;
        was_frame       <= frame;
        was_valid       <= valid;
        was_fresh       <= r_fresh;
        was_done        <= done;
        was_start       <= start;
        was_reading     <= r_reading;
        was_address     <= address;
        was_data        <= data;
        was_value       <= value;
        was_frames      <= r_frames;
        was_unread      <= r_unread;
        was_after       <= r_unread_after;
        was_held        <= held;
        kept_given      <= given;
        kept_newest     <= newest;
        was_opened      <= opened && !rst;
        was_opened_of   <= opened_of;
        was_opened_data <= opened_data;
        if (rst)
            opened <= 1'b0;
        else if (write) begin
            opened      <= wide && !address[2];
            opened_of   <= address[10:3];
            opened_data <= data;
        end
    end

    always @* begin
        if (!begun)
            assume (rst);
        else begin
            if (!was_rst) begin
                counts_to_two: assert (r_unread <= 2'd2 && r_unread_after <= 2'd2);
                unread_at_least_after: assert (r_unread >= r_unread_after);
                pending_is_open: assert (r_pending == opened);
                low_is_kept: assert (!opened || (r_low == opened_data && {5'd0, r_low_of} == opened_of));
                low_alone_changes_nothing: assert (!(was_write && was_pair && !was_high) || !r_bank_write);
                pair_in_one_clock: assert (!(was_write && was_high && was_opened && was_opened_of == was_register)
                    || (r_bank_write && r_bank_address == was_register
                        && r_bank_data == {was_data[15:0], was_opened_data}));
                high_alone_changes_nothing: assert (!(was_write && was_high)
                    || (was_opened && was_opened_of == was_register) || !r_bank_write);
                word_at_once: assert (!(was_write && !was_high && !was_pair)
                    || (r_bank_write && r_bank_address == was_register && r_bank_data == {16'd0, was_data}));
                no_write_by_itself: assert (was_write || !r_bank_write);
                errors_cleared_by_their_register: assert (r_clear == (was_write && !was_high && was_register == 8'h54
                    ? was_data[2:0] : 3'd0));
                high_latched_with_low: assert (!(was_fetch && !was_high)
                    || (r_high == was_value[47:32] && r_high_of == was_register));
                low_is_read: assert (address[2] || o_rdata == value[31:0]);
                high_is_latched: assert (!address[2] || o_rdata == (r_high_of == address[10:3] ? {16'd0, r_high} : 32'd0));
                frames_count: assert (r_frames == was_frames + {11'd0, was_frame});
                sample_of_one_frame: assert (newest == (was_sample ? kept_given : kept_newest));
                taken_as_it_was: assert (!was_take
                    || held == {kept_newest[50:35], was_unread == 2'd2, was_unread != 2'd0, kept_newest[34:4]});
                held_is_held: assert (was_take || held == was_held);
                none_lost_unseen: assert (r_unread == (counted > 3'd2 ? 2'd2 : counted[1:0]));
                counted_from_the_take: assert (r_unread_after == (counted_after > 3'd2 ? 2'd2 : counted_after[1:0]));
                read_while_taken: assert (r_reading == (was_take || (was_reading && !was_start && !was_done)));
                new_until_the_frame: assert (r_fresh == (!was_frame && (was_fresh || was_valid)));
            end
            ready_is_unread: assert (o_data_ready == (r_unread != 2'd0));
            status_is_told: assert (o_bus_status == {r_unread != 2'd0, r_unread == 2'd2, |flags, state == 4'd12, r_pending});
            if (was_rst)
                resets: assert (!r_bank_write && !r_pending && r_clear == 3'd0 && r_unread == 2'd0 && !r_reading
                    && r_frames == 12'd0);
        end
    end

endmodule
