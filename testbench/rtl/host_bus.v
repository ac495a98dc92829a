// Bus of the host: words of 32 bits to registers of up to 48 bits, and a sample of the rate that is read as a whole.
//   fetch   rdata of address is read: a low word latches its high word; the word of SAMPLE_RATE takes the sample
//   write   a register of one word at once; of two words both when the high one comes, in one clock
//   frame   end of the 8 kHz work: a sample if the rate was new
// Latency: 1 clock from write to r_bank_write and r_clear, from frame to a sample.   No rounding.   r_frames wraps.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_host_bus #(
    parameter [7:0] pairs = 8'hBC       // registers of two words, a bit each
) (
    input  wire               clk,
    input  wire               rst,      // synchronous, active high
    input  wire        [10:0] address,  // of a byte
    input  wire               fetch,
    input  wire               start,    // of a frame on the host's port
    input  wire               done,     // a frame with reads was right
    input  wire               write,
    input  wire        [31:0] data,
    input  wire        [47:0] value,    // of the register at address
    input  wire               frame,
    input  wire               valid,    // the rate is new
    input  wire signed [31:0] rate,
    input  wire signed [15:0] temperature,
    input  wire         [2:0] k,
    input  wire         [7:0] flags,
    input  wire         [3:0] state,
    input  wire         [3:0] lock,
    output reg         [15:0] r_high,
    output reg          [7:0] r_high_of,
    output reg         [31:0] r_low,
    output reg          [2:0] r_low_of,
    output reg                r_pending,       // a low word waits for its high word
    output reg                r_bank_write,    // to the register bank
    output reg          [7:0] r_bank_address,
    output reg         [47:0] r_bank_data,
    output reg          [2:0] r_clear,         // errors of the port
    output reg         [11:0] r_frames,
    output reg                r_fresh,         // the rate was new in this frame
    output reg  signed [31:0] r_rate,          // the newest sample
    output reg  signed [15:0] r_temperature,
    output reg         [18:0] r_status,
    output reg         [11:0] r_number,
    output reg  signed [15:0] r_held_temperature,
    output reg         [20:0] r_held_status,
    output reg         [11:0] r_held_number,
    output reg          [1:0] r_unread,        // samples since the last that was read, to 2
    output reg          [1:0] r_unread_after,  // samples since the last that was taken, to 2
    output reg                r_reading,       // a sample was taken in this frame of the port
    output wire        [31:0] o_rdata,
    output wire         [4:0] o_bus_status,
    output wire               o_data_ready
);

    localparam [7:0] SPI_ERRORS = 8'h54;
    localparam [10:0] SAMPLE_RATE = 11'h280;
    localparam [3:0] LOCKED = 4'd12;
    localparam [1:0] MANY = 2'd2;

    wire [7:0] register = address[10:3];
    wire second = address[2];
    wire pair = register[7:3] == 5'd0 && pairs[register[2:0]];
    wire low_written = write && !second && pair;
    wire high_written = write && second && r_pending && {5'd0, r_low_of} == register;
    wire word_written = write && !second && !pair;

    wire sample = frame && (r_fresh || valid);
    wire take = fetch && address == SAMPLE_RATE;
    wire [1:0] after = take ? 2'd0 : r_unread_after;
    wire [1:0] left = done && r_reading ? r_unread_after : r_unread;
    wire ready = r_unread != 2'd0;
    wire overrun = r_unread == MANY;

    assign o_rdata = !second ? value[31:0] : r_high_of == register ? {16'd0, r_high} : 32'd0;
    assign o_bus_status = {ready, overrun, flags != 8'd0, state == LOCKED, r_pending};
    assign o_data_ready = ready;

    always @(posedge clk) begin
        if (rst) begin
            r_high             <= 16'd0;
            r_high_of          <= 8'd0;
            r_low              <= 32'd0;
            r_low_of           <= 3'd0;
            r_pending          <= 1'b0;
            r_bank_write       <= 1'b0;
            r_bank_address     <= 8'd0;
            r_bank_data        <= 48'd0;
            r_clear            <= 3'd0;
            r_frames           <= 12'd0;
            r_fresh            <= 1'b0;
            r_rate             <= 32'sd0;
            r_temperature      <= 16'sd0;
            r_status           <= 19'd0;
            r_number           <= 12'd0;
            r_held_temperature <= 16'sd0;
            r_held_status      <= 21'd0;
            r_held_number      <= 12'd0;
            r_unread           <= 2'd0;
            r_unread_after     <= 2'd0;
            r_reading          <= 1'b0;
        end else begin
            if (fetch && !second) begin
                r_high    <= value[47:32];
                r_high_of <= register;
            end
            if (write)
                r_pending <= low_written;
            if (low_written) begin
                r_low    <= data;
                r_low_of <= register[2:0];
            end
            r_bank_write <= word_written || high_written;
            if (word_written || high_written) begin
                r_bank_address <= register;
                r_bank_data    <= second ? {data[15:0], r_low} : {16'd0, data};
            end
            r_clear <= word_written && register == SPI_ERRORS ? data[2:0] : 3'd0;
            if (frame)
                r_frames <= r_frames + 12'd1;
            r_fresh <= !frame && (r_fresh || valid);
            if (sample) begin
                r_rate        <= rate;
                r_temperature <= temperature;
                r_status      <= {k, lock, state, flags};
                r_number      <= r_frames;
            end
            if (take) begin
                r_held_temperature <= r_temperature;
                r_held_status      <= {overrun, ready, r_status};
                r_held_number      <= r_number;
            end
            r_unread       <= sample && left != MANY ? left + 2'd1 : left;
            r_unread_after <= sample && after != MANY ? after + 2'd1 : after;
            r_reading      <= take || (r_reading && !start && !done);
        end
    end

endmodule
