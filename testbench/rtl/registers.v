// Register bank of the host: the writable part of the map; addresses, widths and reset values are those of the map.
//   write: the register of that address takes the low bits of data; no other address does anything
//   fault_clear: ones written to it are added; taken: it returns to 0, except for ones written in that clock
// Latency: 1 clock from write to the register.   No rounding.   Bits above a register's width are dropped.
// Formats are those of the default design.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_registers #(
    parameter [31:0] MASTER_HZ = 32'd26000000,  // clk
    parameter        DDS_BITS  = 48             // width of phases and of the frequency
) (
    input  wire                       clk,
    input  wire                       rst,                   // synchronous, active high
    input  wire                       write,
    input  wire                 [7:0] address,               // [0,8,0]
    /* verilator lint_off UNUSED */                          // waived: bits above the widest register
    input  wire                [47:0] data,                  // [0,48,0]
    /* verilator lint_on UNUSED */
    input  wire                       taken,                 // the sequencer has read fault_clear
    output reg                  [8:0] r_control,             // 0x00 [0,9,0] bits
    output reg                  [7:0] r_fault_clear,         // 0x01 [0,8,0] bits
    output reg         [DDS_BITS-1:0] r_phase_drive_sine,    // 0x02 [0,0,48] turn
    output reg         [DDS_BITS-1:0] r_phase_sense_sine,    // 0x03 [0,0,48] turn
    output reg         [DDS_BITS-1:0] r_phase_drive_ref,     // 0x04 [0,0,48] turn
    output reg         [DDS_BITS-1:0] r_phase_sense_ref,     // 0x05 [0,0,48] turn
    output reg                 [23:0] r_amplitude_setpoint,  // 0x06 [0,24,0] magnitude LSB
    output reg         [DDS_BITS-1:0] r_frequency_fixed,     // 0x07 [0,0,48] turn per clock
    output reg  signed         [23:0] r_amplitude_fixed,     // 0x08 [1,0,23] 10 V
    output reg  signed         [23:0] r_rate_fixed,          // 0x09 [1,0,23] 10 V
    output reg                 [31:0] r_quadrature_fixed,    // 0x0A [0,32,0] (5.5 V)^2 / 2^32
    output reg  signed         [31:0] r_rate_bias,           // 0x0B [1,23,8] word LSB
    output reg  signed         [31:0] r_rate_bias_t1,        // 0x0C [1,7,24] word LSB per t
    output reg  signed         [31:0] r_rate_bias_t2,        // 0x0D [1,7,24] word LSB per t2
    output reg  signed         [29:0] r_rate_scale,          // 0x0E [1,1,28] 1
    output reg  signed         [23:0] r_rate_scale_t1,       // 0x0F [1,-17,40] 1 per t
    output reg  signed         [23:0] r_rate_scale_t2,       // 0x10 [1,-17,40] 1 per t2
    output reg                  [2:0] r_decimation           // 0x11 [0,3,0] log2
);

    // 11 kHz in turns per clock, rounded
    localparam [63:0] TWICE = (64'd11000 << (DDS_BITS + 1)) / {32'd0, MASTER_HZ} + 64'd1;
    localparam [DDS_BITS-1:0] NOMINAL_WORD = TWICE[DDS_BITS:1];

    always @(posedge clk) begin
        if (rst) begin
            r_control            <= 9'h1;
            r_fault_clear        <= 8'h0;
            r_phase_drive_sine   <= {DDS_BITS{1'b0}};
            r_phase_sense_sine   <= {DDS_BITS{1'b0}};
            r_phase_drive_ref    <= {DDS_BITS{1'b0}};
            r_phase_sense_ref    <= {DDS_BITS{1'b0}};
            r_amplitude_setpoint <= 24'h97C3F3;
            r_frequency_fixed    <= NOMINAL_WORD;
            r_amplitude_fixed    <= 24'sh0;
            r_rate_fixed         <= 24'sh0;
            r_quadrature_fixed   <= 32'h0;
            r_rate_bias          <= 32'sh0;
            r_rate_bias_t1       <= 32'sh0;
            r_rate_bias_t2       <= 32'sh0;
            r_rate_scale         <= 30'sh793569E;
            r_rate_scale_t1      <= 24'sh0;
            r_rate_scale_t2      <= 24'sh0;
            r_decimation         <= 3'h3;
        end else begin
            if (taken)
                r_fault_clear <= 8'h0;
            if (write)
                case (address)
                    8'h00: r_control            <= data[8:0];
                    8'h01: r_fault_clear        <= (taken ? 8'h0 : r_fault_clear) | data[7:0];
                    8'h02: r_phase_drive_sine   <= data[DDS_BITS-1:0];
                    8'h03: r_phase_sense_sine   <= data[DDS_BITS-1:0];
                    8'h04: r_phase_drive_ref    <= data[DDS_BITS-1:0];
                    8'h05: r_phase_sense_ref    <= data[DDS_BITS-1:0];
                    8'h06: r_amplitude_setpoint <= data[23:0];
                    8'h07: r_frequency_fixed    <= data[DDS_BITS-1:0];
                    8'h08: r_amplitude_fixed    <= data[23:0];
                    8'h09: r_rate_fixed         <= data[23:0];
                    8'h0A: r_quadrature_fixed   <= data[31:0];
                    8'h0B: r_rate_bias          <= data[31:0];
                    8'h0C: r_rate_bias_t1       <= data[31:0];
                    8'h0D: r_rate_bias_t2       <= data[31:0];
                    8'h0E: r_rate_scale         <= data[29:0];
                    8'h0F: r_rate_scale_t1      <= data[23:0];
                    8'h10: r_rate_scale_t2      <= data[23:0];
                    8'h11: r_decimation         <= data[2:0];
                    default: ;
                endcase
        end
    end

endmodule
