// SPI slave of the host, mode 0, SCK sampled by clk: a command of 16 bits, up to 7 words of 32 bits and a CRC of 8.
//   command       15 read   14..12 words   11 zero   10..0 byte address       a read has a CRC behind its command too
//   CS_N rises    a frame of the right length, CRC and command: r_write for a clock per word, or r_done; else r_errors
//   o_fetch       rdata of r_address is taken
// Latency: 3 clocks from the edge that sees SCK high to the next bit on SDO; 3 from CS_N high to r_write and r_done.
// SDO of a chip without the bus (CS_N high) must be released by the pin itself.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_spi_slave (
    input  wire        clk,
    input  wire        rst,          // synchronous, active high
    input  wire        cs_n,         // asynchronous, as are sck and sdi
    input  wire        sck,
    input  wire        sdi,
    input  wire  [4:0] status,       // of the bus: the high bits of the status byte
    input  wire [31:0] rdata,        // word at r_address
    input  wire  [2:0] clear,        // of r_errors
    output reg         r_cs_meta,
    output reg         r_cs_n,
    output reg         r_active,
    output reg         r_sck_meta,
    output reg         r_sck,
    output reg         r_sck_seen,
    output reg         r_sdi_meta,
    output reg         r_sdi,
    output reg   [2:0] r_phase,      // 0 COMMAND, 1 CHECK, 2 DATA, 3 TAIL, 4 COMPLETE, 5 TOO_LONG
    output reg   [4:0] r_bit,        // of the phase
    output reg   [2:0] r_words,      // still to come
    output reg         r_read,
    output reg  [10:0] r_address,
    output reg   [7:0] r_crc,
    output reg  [39:0] r_shift,
    output reg  [31:0] r_data,
    output reg         r_second,     // a second word is in the shift register
    output reg         r_spoiled,    // wrong CRC
    output reg         r_refused,    // wrong command
    output reg         r_write,
    output reg         r_done,
    output reg   [2:0] r_errors,     // 0 CRC, 1 LENGTH, 2 COMMAND
    output wire        o_sdo,
    output wire        o_fetch,
    output wire        o_start
);

    localparam [2:0] COMMAND = 3'd0, CHECK = 3'd1, DATA = 3'd2, TAIL = 3'd3, COMPLETE = 3'd4, TOO_LONG = 3'd5;
    localparam [2:0] WRONG_CRC = 3'b001, WRONG_LENGTH = 3'b010, WRONG_COMMAND = 3'b100;
    localparam [2:0] MOST_WRITTEN = 3'd2;

    wire rises = !r_cs_n && r_sck && !r_sck_seen;
    wire [39:0] shifted = {r_shift[38:0], r_sdi};
    wire [7:0] told = {status, r_errors};

    // ends of the parts of a frame
    wire command_ends = r_phase == COMMAND && r_bit == 5'd15;
    wire check_ends = r_phase == CHECK && r_bit == 5'd7;
    wire word_ends = r_phase == DATA && r_bit == 5'd31;
    wire tail_ends = r_phase == TAIL && r_bit == 5'd7;
    wire last = r_words <= 3'd1;

    // the host sees the bit that leaves a read, and the slave the bit of a write
    wire covered = r_phase == DATA && r_read ? r_shift[39] : r_sdi;
    wire [7:0] divided = {r_crc[6:0], 1'b0} ^ (r_crc[7] != covered ? 8'h1D : 8'h00);
    wire differs = shifted[7:0] != ~r_crc;

    wire ends = r_cs_n && r_active;
    wire complete = r_phase == COMPLETE;
    wire good = ends && complete && !r_spoiled && !r_refused;
    wire empty = r_phase == COMMAND && r_bit == 5'd0;
    wire [2:0] wrong = !ends || good ? 3'd0
        : complete ? (r_spoiled ? WRONG_CRC : WRONG_COMMAND)
        : empty ? 3'd0 : WRONG_LENGTH;
    wire follows = r_write && r_second;

    assign o_sdo = r_shift[39];
    assign o_fetch = rises && r_read && (check_ends || (word_ends && !last));
    assign o_start = !r_cs_n && !r_active;

    always @(posedge clk) begin
        if (rst) begin
            r_cs_meta  <= 1'b1;
            r_cs_n     <= 1'b1;
            r_active   <= 1'b0;
            r_sck_meta <= 1'b0;
            r_sck      <= 1'b0;
            r_sck_seen <= 1'b0;
            r_sdi_meta <= 1'b0;
            r_sdi      <= 1'b0;
            r_phase    <= COMMAND;
            r_bit      <= 5'd0;
            r_words    <= 3'd0;
            r_read     <= 1'b0;
            r_address  <= 11'd0;
            r_crc      <= 8'hFF;
            r_shift    <= 40'd0;
            r_data     <= 32'd0;
            r_second   <= 1'b0;
            r_spoiled  <= 1'b0;
            r_refused  <= 1'b0;
            r_write    <= 1'b0;
            r_done     <= 1'b0;
            r_errors   <= 3'd0;
        end else begin
            r_cs_meta  <= cs_n;
            r_cs_n     <= r_cs_meta;
            r_active   <= !r_cs_n;
            r_sck_meta <= sck;
            r_sck      <= r_sck_meta;
            r_sck_seen <= r_sck;
            r_sdi_meta <= sdi;
            r_sdi      <= r_sdi_meta;
            r_write    <= follows || (good && !r_read);
            r_done     <= good && r_read;
            r_errors   <= (r_errors & ~clear) | wrong;
            if (follows) begin
                r_data    <= r_shift[39:8];
                r_address <= r_address + 11'd4;
                r_second  <= 1'b0;
            end
            if (r_cs_n) begin
                r_phase   <= COMMAND;
                r_bit     <= 5'd0;
                r_crc     <= 8'hFF;
                r_spoiled <= 1'b0;
                r_refused <= 1'b0;
                if (!r_active)
                    r_shift <= {told, ~told, 24'd0};
                else if (!good)
                    r_second <= 1'b0;
                else if (!r_second)
                    r_data <= r_shift[39:8];
            end else if (rises) begin
                r_bit   <= r_bit + 5'd1;
                r_shift <= shifted;
                if (r_phase == COMMAND || r_phase == DATA)
                    r_crc <= divided;
                if (command_ends) begin
                    r_phase   <= shifted[15] ? CHECK : DATA;
                    r_bit     <= 5'd0;
                    r_read    <= shifted[15];
                    r_words   <= shifted[14:12];
                    r_address <= shifted[10:0];
                    r_refused <= shifted[14:12] == 3'd0 || (!shifted[15] && shifted[14:12] > MOST_WRITTEN)
                        || shifted[11] || shifted[1:0] != 2'd0;
                end
                if (check_ends) begin
                    r_phase   <= DATA;
                    r_bit     <= 5'd0;
                    r_spoiled <= differs;
                end
                if (word_ends && last) begin
                    r_phase <= TAIL;
                    if (r_read)
                        r_shift <= {~divided, 32'd0};
                end
                if (word_ends && !last) begin
                    r_words <= r_words - 3'd1;
                    if (!r_read) begin
                        r_data   <= shifted[31:0];
                        r_second <= 1'b1;
                    end
                end
                if (o_fetch) begin
                    r_shift   <= {rdata, 8'd0};
                    r_address <= r_address + 11'd4;
                end
                if (tail_ends) begin
                    r_phase <= COMPLETE;
                    r_bit   <= 5'd0;
                    if (!r_read)
                        r_spoiled <= differs;
                end
                if (complete)
                    r_phase <= TOO_LONG;
            end
        end
    end

endmodule
