// Faults of the 8 kHz frames: one counter each, live flags, and a sticky latch.
//   count: +1 while its symptom lasts, else 0; flag: count is at its limit; latch = (latch and not clear) or flags
// Latency: 1 clock from en to flags and latch.   No rounding.   The counts saturate.
// Frames in a row, good or bad, are counted up to `top`.
// Without armed everything stays at its reset value, but the codes. A limit of 0 switches a fault off.
// Inputs that share their name with a limit begin with i_: parameters and ports have one name space.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_fault_monitor #(
    parameter [11:0] over_range = 12'd0,          // [0,12,0] frames, all five
    parameter [11:0] stuck      = 12'd0,
    parameter [11:0] drive      = 12'd0,
    parameter [11:0] rate       = 12'd0,
    parameter [11:0] rail       = 12'd0,
    parameter [15:0] top        = 16'hFFFF        // [0,16,0] frames
) (
    input  wire               clk,
    input  wire               rst,                // synchronous, active high
    input  wire               en,
    input  wire               armed,
    input  wire               fresh,              // the frame is valid
    input  wire signed [23:0] codes_0,            // [1,23,0] drive sin, drive cos, sense sin, sense cos
    input  wire signed [23:0] codes_1,
    input  wire signed [23:0] codes_2,
    input  wire signed [23:0] codes_3,
    input  wire               i_drive,            // amplitude at its ceiling
    input  wire               i_rate,             // rate word at a limit
    input  wire               i_rail,             // u at 0 or at the rail
    input  wire               watch_stuck,
    input  wire         [7:0] levels,             // LOST_LOCK and SEARCH_FAILED
    input  wire         [7:0] clear,
    output reg  signed [23:0] r_codes_0,
    output reg  signed [23:0] r_codes_1,
    output reg  signed [23:0] r_codes_2,
    output reg  signed [23:0] r_codes_3,
    output reg         [11:0] r_over_range,       // [0,12,0]
    output reg         [11:0] r_stuck,
    output reg         [11:0] r_drive,
    output reg         [11:0] r_rate,
    output reg         [11:0] r_rail,
    output reg         [15:0] r_bad_frames,       // [0,16,0]
    output reg         [15:0] r_good_frames,
    output reg          [7:0] r_flags,
    output reg          [7:0] r_latch
);

    localparam signed [23:0] RANGE_HI = 24'sh7FFF00, RANGE_LO = -24'sh7FFF00;

    // count of a symptom, held at its limit
    function [11:0] counted;
        input [11:0] count;
        input        symptom;
        input [11:0] limit;
        counted = !symptom ? 12'd0 : (count >= limit) ? limit : count + 12'd1;
    endfunction

    function reached;
        input [11:0] count;
        input [11:0] limit;
        reached = (limit != 12'd0) && (count == limit);
    endfunction

    function extreme;
        input signed [23:0] code;
        extreme = (code >= RANGE_HI) || (code <= RANGE_LO);
    endfunction

    wire any_extreme = extreme(codes_0) || extreme(codes_1) || extreme(codes_2) || extreme(codes_3);
    // a code at its limit is clipped, and may rest
    wire same = ((codes_0 == r_codes_0) && !extreme(codes_0)) || ((codes_1 == r_codes_1) && !extreme(codes_1)) ||
                ((codes_2 == r_codes_2) && !extreme(codes_2)) || ((codes_3 == r_codes_3) && !extreme(codes_3));

    wire [11:0] next_over_range = counted(r_over_range, fresh && any_extreme, over_range);
    wire [11:0] next_stuck = counted(r_stuck, fresh && watch_stuck && same, stuck);
    wire [11:0] next_drive = counted(r_drive, i_drive, drive);
    wire [11:0] next_rate = counted(r_rate, i_rate, rate);
    wire [11:0] next_rail = counted(r_rail, i_rail, rail);

    wire is_stuck = reached(next_stuck, stuck);
    // bit 0 OVER_RANGE, 1 LOST_LOCK, 2 STALE, 3 STUCK, 4 DRIVE_SATURATED, 5 RATE_SATURATED, 6 QSC_RAIL, 7 SEARCH_FAILED
    wire [7:0] flags = levels | {1'b0, reached(next_rail, rail), reached(next_rate, rate), reached(next_drive, drive),
                                 is_stuck, !fresh, 1'b0, reached(next_over_range, over_range)};
    wire bad = flags[2] || flags[3];

    always @(posedge clk) begin
        if (rst) begin
            r_codes_0 <= 24'sd0;
            r_codes_1 <= 24'sd0;
            r_codes_2 <= 24'sd0;
            r_codes_3 <= 24'sd0;
        end else if (en && (fresh || !armed)) begin
            r_codes_0 <= codes_0;
            r_codes_1 <= codes_1;
            r_codes_2 <= codes_2;
            r_codes_3 <= codes_3;
        end
        if (rst || (en && !armed)) begin
            r_over_range  <= 12'd0;
            r_stuck       <= 12'd0;
            r_drive       <= 12'd0;
            r_rate        <= 12'd0;
            r_rail        <= 12'd0;
            r_bad_frames  <= 16'd0;
            r_good_frames <= 16'd0;
            r_flags       <= 8'd0;
            r_latch       <= 8'd0;
        end else if (en) begin
            r_over_range  <= next_over_range;
            r_stuck       <= next_stuck;
            r_drive       <= next_drive;
            r_rate        <= next_rate;
            r_rail        <= next_rail;
            r_bad_frames  <= !bad ? 16'd0 : (r_bad_frames == top) ? top : r_bad_frames + 16'd1;
            r_good_frames <= bad ? 16'd0 : (r_good_frames == top) ? top : r_good_frames + 16'd1;
            r_flags       <= flags;
            r_latch       <= (r_latch & ~clear) | flags;
        end
    end

endmodule
