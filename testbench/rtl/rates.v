// Clock enables of the one clock domain: 26 clocks a tick, 125 ticks a frame, and the slots of the 8 kHz work.
//   slot: 1 after go, then counts to SLOTS and returns to 0; a new go restarts it
// Latency: 1 clock from go to slot = 1; the enables are decoded from the registers.
// No rounding. tick wraps at 26, frame at 125.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_rates (
    input  wire       clk,
    input  wire       rst,      // synchronous, active high
    input  wire       go,
    output reg  [4:0] r_tick,   // [0,5,0]
    output reg  [6:0] r_frame,  // [0,7,0]
    output reg  [5:0] r_slot,   // [0,6,0]
    output wire       o_ce_1m,
    output wire       o_ce_8k
);

    localparam [4:0] LAST_CYCLE = 5'd25;
    localparam [6:0] LAST_TICK = 7'd124;
    localparam [5:0] SLOTS = 6'd60;

    assign o_ce_1m = (r_tick == 5'd0);
    assign o_ce_8k = o_ce_1m && (r_frame == 7'd0);

    always @(posedge clk) begin
        if (rst) begin
            r_tick  <= 5'd0;
            r_frame <= 7'd0;
            r_slot  <= 6'd0;
        end else begin
            if (r_tick == LAST_CYCLE) begin
                r_tick  <= 5'd0;
                r_frame <= (r_frame == LAST_TICK) ? 7'd0 : r_frame + 7'd1;
            end else
                r_tick <= r_tick + 5'd1;
            if (go)
                r_slot <= 6'd1;
            else if (r_slot == 6'd0 || r_slot == SLOTS)
                r_slot <= 6'd0;
            else
                r_slot <= r_slot + 6'd1;
        end
    end

endmodule
