// Clock enables of the one clock domain: clocks of a tick, ticks of a frame, and the slots of the 8 kHz work.
//   slot: 1 after go, then counts to SLOTS and returns to 0; a new go restarts it
// Latency: 1 clock from go to slot = 1; the enables are decoded from the registers.
// No rounding. tick wraps at TICK_CLOCKS, frame at FRAME_TICKS. Formats are those of the default design.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_rates #(
    parameter TICK_CLOCKS = 26,  // clocks to a tick
    parameter FRAME_TICKS = 125  // ticks to a frame
) (
    input  wire                           clk,
    input  wire                           rst,      // synchronous, active high
    input  wire                           go,
    output reg  [$clog2(TICK_CLOCKS)-1:0] r_tick,   // [0,5,0]
    output reg  [$clog2(FRAME_TICKS)-1:0] r_frame,  // [0,7,0]
    output reg                      [5:0] r_slot,   // [0,6,0]
    output wire                           o_ce_1m,
    output wire                           o_ce_8k
);

    localparam TICK_BITS = $clog2(TICK_CLOCKS), FRAME_BITS = $clog2(FRAME_TICKS);
    localparam [TICK_BITS-1:0] NO_TICK = 0;
    localparam [FRAME_BITS-1:0] NO_FRAME = 0;
    localparam [31:0] LAST_CYCLE = TICK_CLOCKS - 1, LAST_TICK = FRAME_TICKS - 1;
    localparam [5:0] SLOTS = 6'd60;

    assign o_ce_1m = (r_tick == NO_TICK);
    assign o_ce_8k = o_ce_1m && (r_frame == NO_FRAME);

    always @(posedge clk) begin
        if (rst) begin
            r_tick  <= NO_TICK;
            r_frame <= NO_FRAME;
            r_slot  <= 6'd0;
        end else begin
            if (r_tick == LAST_CYCLE[TICK_BITS-1:0]) begin
                r_tick  <= NO_TICK;
                r_frame <= (r_frame == LAST_TICK[FRAME_BITS-1:0]) ? NO_FRAME : r_frame + 1'b1;
            end else
                r_tick <= r_tick + 1'b1;
            if (go)
                r_slot <= 6'd1;
            else if (r_slot == 6'd0 || r_slot == SLOTS)
                r_slot <= 6'd0;
            else
                r_slot <= r_slot + 6'd1;
        end
    end

endmodule
