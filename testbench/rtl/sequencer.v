// Start-up, lock and faults: a state machine at 8 kHz that gives each loop its mode.
//   POWER_UP, INIT, IDLE, STANDBY, KICK, DECAY, SEARCH, RETUNE, ACQUIRE, SETTLE, BALANCE <-> LOCKED; OPEN by OPEN_DRIVE
//   in SEARCH: rotation += wrap(phase - last_phase); correction = round(rotation*gain)
// Latency: 1 clock from en to the outputs, which are decoded from the registers; decisions read the bits of the frame
// before.   Rounding: ties toward +inf in correction.   Overflow: timer and attempts saturate; no other can overflow.
// Formats are those of the default design.
/* verilator lint_off DECLFILENAME */ // waived: a file has the stem of its block, the module a prefix against clashes
module gyro_sequencer #(
    parameter                       DDS_BITS          = 48,       // width of a word
    parameter                [15:0] power_up          = 16'd0,    // [0,16,0] frames
    parameter                [15:0] init              = 16'd0,
    parameter                [15:0] kick              = 16'd0,
    parameter                [15:0] decay             = 16'd0,
    parameter                [15:0] search            = 16'd0,
    parameter                [15:0] retune            = 16'd0,
    parameter                [15:0] timeout           = 16'd0,
    parameter                [15:0] offline           = 16'd0,
    parameter                [15:0] recover           = 16'd0,
    parameter                [16:0] reached           = 17'd0,    // [0,17,0] 2**-16 of the setpoint
    parameter                [24:0] min_magnitude     = 25'd0,    // [0,25,0]
    parameter                [23:0] gain              = 24'd0,    // [0,8,16]
    parameter signed [DDS_BITS-1:0] search_limit      = 0,        // [1,-1,48] turns per clock
    parameter                [23:0] lock_limit_in_0   = 24'd0,    // as gyro_lock_monitor
    parameter                [23:0] lock_limit_in_1   = 24'd0,
    parameter                [23:0] lock_limit_in_2   = 24'd0,
    parameter                [23:0] lock_limit_in_3   = 24'd0,
    parameter                [23:0] lock_limit_out_0  = 24'd0,
    parameter                [23:0] lock_limit_out_1  = 24'd0,
    parameter                [23:0] lock_limit_out_2  = 24'd0,
    parameter                [23:0] lock_limit_out_3  = 24'd0,
    parameter                [11:0] lock_frames_in_0  = 12'd0,
    parameter                [11:0] lock_frames_in_1  = 12'd0,
    parameter                [11:0] lock_frames_in_2  = 12'd0,
    parameter                [11:0] lock_frames_in_3  = 12'd0,
    parameter                [11:0] lock_frames_out_0 = 12'd0,
    parameter                [11:0] lock_frames_out_1 = 12'd0,
    parameter                [11:0] lock_frames_out_2 = 12'd0,
    parameter                [11:0] lock_frames_out_3 = 12'd0,
    parameter                [11:0] faults_over_range = 12'd0,    // [0,12,0] frames, as gyro_fault_monitor
    parameter                [11:0] faults_stuck      = 12'd0,
    parameter                [11:0] faults_drive      = 12'd0,
    parameter                [11:0] faults_rate       = 12'd0,
    parameter                [11:0] faults_rail       = 12'd0,
    parameter                [15:0] faults_top        = 16'hFFFF  // [0,16,0] frames
) (
    input  wire                       clk,
    input  wire                       rst,                   // synchronous, active high
    input  wire                       en,
    input  wire                 [8:0] i_control,
    input  wire                 [7:0] i_clear,
    input  wire                       i_adc_ok,
    input  wire                       i_stale,
    input  wire signed         [23:0] i_drive_sin,           // [1,23,0]
    input  wire signed         [23:0] i_drive_cos,
    input  wire signed         [23:0] i_sense_sin,
    input  wire signed         [23:0] i_sense_cos,
    input  wire                [24:0] i_magnitude,           // [0,25,0]
    input  wire signed         [23:0] i_phase,               // [1,-1,24] turn
    input  wire                [23:0] i_setpoint,            // [0,24,0]
    input  wire                       i_drive_saturated,
    input  wire                       i_rate_saturated,
    input  wire                       i_qsc_rail,
    output reg                  [3:0] r_state,
    output reg                 [15:0] r_timer,               // [0,16,0] frames
    output reg                  [8:0] r_control,
    output reg  signed         [23:0] r_last_phase,          // [1,-1,24] turn
    output reg  signed         [35:0] r_rotation,            // [1,11,24] turn
    output reg  signed [DDS_BITS-1:0] r_correction,          // [1,-1,48] turns per clock
    output reg                  [7:0] r_attempts,            // [0,8,0]
    output reg                        r_lost,
    output reg                        r_failed,
    output wire                 [3:0] r_lock_locked,
    output wire                [11:0] r_lock_count_0,
    output wire                [11:0] r_lock_count_1,
    output wire                [11:0] r_lock_count_2,
    output wire                [11:0] r_lock_count_3,
    output wire signed         [23:0] r_faults_codes_0,
    output wire signed         [23:0] r_faults_codes_1,
    output wire signed         [23:0] r_faults_codes_2,
    output wire signed         [23:0] r_faults_codes_3,
    output wire                [11:0] r_faults_over_range,
    output wire                [11:0] r_faults_stuck,
    output wire                [11:0] r_faults_drive,
    output wire                [11:0] r_faults_rate,
    output wire                [11:0] r_faults_rail,
    output wire                [15:0] r_faults_bad_frames,
    output wire                [15:0] r_faults_good_frames,
    output wire                 [7:0] r_faults_flags,
    output wire                 [7:0] r_faults_latch,
    output reg                  [2:0] o_agc_mode,
    output reg                  [1:0] o_pll_mode,
    output reg                  [1:0] o_ftr_mode,
    output reg                  [1:0] o_qsc_mode,
    output wire                       o_fix_drive,
    output wire                       o_fix_ftr,
    output wire                       o_fix_qsc,
    output wire                       o_dac_init,
    output wire                       o_load,
    output wire                       o_adjust,
    output wire                       o_drive_locked,
    output wire                       o_locked,
    output wire                       o_rate_good
);

    localparam [3:0] POWER_UP = 4'd0, INIT = 4'd1, IDLE = 4'd2, STANDBY = 4'd3, OPEN = 4'd4, KICK = 4'd5, DECAY = 4'd6,
                     SEARCH = 4'd7, RETUNE = 4'd8, ACQUIRE = 4'd9, SETTLE = 4'd10, BALANCE = 4'd11, LOCKED = 4'd12;
    // bits of control
    localparam RUN = 0, HOLD_AGC = 1, HOLD_PLL = 2, HOLD_FTR = 3, HOLD_QSC = 4, FIX_FTR = 5, FIX_QSC = 6,
               OPEN_DRIVE = 7, CLEAR_FAULTS = 8;
    // bits of the flags
    localparam OVER_RANGE = 0, STALE = 2, STUCK = 3, RATE_SATURATED = 5;
    // modes of the loops; the last one is of the AGC only
    localparam [1:0] LOOP_OFF = 2'd0, LOOP_P_ONLY = 2'd1, LOOP_RUN = 2'd2, LOOP_HOLD = 2'd3;
    localparam [2:0] AGC_KICK = 3'd4;

    wire fresh = i_adc_ok && !i_stale;
    wire usable = fresh && !r_faults_flags[STUCK];

    // loops whose lock counts, and lock bits that the others cannot withhold: 0 agc, 1 pll, 2 ftr, 3 qsc
    wire [3:0] judged = {!(i_control[HOLD_QSC] || i_control[FIX_QSC]), !(i_control[HOLD_FTR] || i_control[FIX_FTR]),
                         !i_control[HOLD_PLL], !i_control[HOLD_AGC]};
    wire [3:0] locked = r_lock_locked | ~judged;
    wire drive_locked = locked[0] && locked[1];
    wire sense_locked = locked[2] && locked[3];

    // the difference wraps at one turn
    wire signed [23:0] turned = i_phase - r_last_phase;
    wire signed [35:0] rotation = (r_state == SEARCH && usable) ? r_rotation + {{12{turned[23]}}, turned} : 36'sd0;
    wire signed [59:0] scaled = $signed({36'd0, gain}) * {{24{rotation[35]}}, rotation} + 60'sd32768;
    /* verilator lint_off UNUSED */                  // waived: what rounding drops, and the sign above a narrow word
    wire [15:0] dropped = scaled[15:0];
    wire [47:0] rounded = {{4{scaled[59]}}, scaled[59:16]};
    /* verilator lint_on UNUSED */
    wire signed [DDS_BITS-1:0] correction = rounded[DDS_BITS-1:0];
    wire signed [DDS_BITS-1:0] shift = correction[DDS_BITS-1] ? -correction : correction;
    wire found = (shift <= search_limit) && (i_magnitude >= min_magnitude);

    wire [40:0] wanted = {17'd0, i_setpoint} * {24'd0, reached};
    wire near_setpoint = ({i_magnitude, 16'd0} >= wanted);

    wire [16:0] frames = {1'b0, r_timer} + 17'd1;
    reg [3:0] following;
    always @* begin
        following = r_state;
        if (r_state == POWER_UP) begin
            if (frames >= {1'b0, power_up}) following = INIT;
        end else if (r_state == INIT) begin
            if (frames >= {1'b0, init}) following = IDLE;
        end else if (!i_control[RUN])
            following = IDLE;
        else if (i_control[OPEN_DRIVE])
            following = OPEN;
        else if (r_state == IDLE || r_state == OPEN)
            following = STANDBY;
        else if (r_state == STANDBY) begin
            if (r_faults_good_frames >= recover) following = KICK;
        end else if (r_faults_bad_frames >= offline)
            following = STANDBY;
        else
            case (r_state)
                KICK:
                    if (frames >= {1'b0, kick}) following = DECAY;
                DECAY:
                    if (usable && frames >= {1'b0, decay}) following = SEARCH;
                SEARCH:
                    if (!usable) following = DECAY;
                    else if (frames >= {1'b0, search}) following = found ? RETUNE : KICK;
                RETUNE:
                    if (frames >= {1'b0, retune}) following = ACQUIRE;
                ACQUIRE:
                    if (usable && near_setpoint) following = SETTLE;
                    else if (frames >= {1'b0, timeout}) following = KICK;
                SETTLE:
                    if (drive_locked) following = BALANCE;
                    else if (frames >= {1'b0, timeout}) following = KICK;
                default:
                    following = !drive_locked ? KICK : sense_locked ? LOCKED : BALANCE;
            endcase
    end

    wire restart = (following == KICK) && (r_state != KICK) && (r_state != STANDBY);
    wire failed = restart && (r_state < BALANCE);
    wire lost = restart && (r_state >= BALANCE);
    wire forget = (following == IDLE) || (following >= BALANCE);
    wire rewind = (following != r_state) || (r_state == DECAY && !usable);

    always @(posedge clk) begin
        if (rst) begin
            r_state      <= POWER_UP;
            r_timer      <= 16'd0;
            r_control    <= 9'd0;
            r_last_phase <= 24'sd0;
            r_rotation   <= 36'sd0;
            r_correction <= {DDS_BITS{1'b0}};
            r_attempts   <= 8'd0;
            r_lost       <= 1'b0;
            r_failed     <= 1'b0;
        end else if (en) begin
            r_state    <= following;
            r_timer    <= rewind ? 16'd0 : frames[16] ? r_timer : frames[15:0];
            r_control  <= i_control;
            r_rotation <= rotation;
            if (fresh)
                r_last_phase <= i_phase;
            if (r_state == SEARCH)
                r_correction <= correction;
            if (failed && r_attempts != 8'hFF)
                r_attempts <= r_attempts + 8'd1;
            r_lost   <= !forget && (r_lost || lost);
            r_failed <= !forget && (r_failed || failed);
        end
    end

    gyro_lock_monitor #(
        .limit_in_0  (lock_limit_in_0),
        .limit_in_1  (lock_limit_in_1),
        .limit_in_2  (lock_limit_in_2),
        .limit_in_3  (lock_limit_in_3),
        .limit_out_0 (lock_limit_out_0),
        .limit_out_1 (lock_limit_out_1),
        .limit_out_2 (lock_limit_out_2),
        .limit_out_3 (lock_limit_out_3),
        .frames_in_0 (lock_frames_in_0),
        .frames_in_1 (lock_frames_in_1),
        .frames_in_2 (lock_frames_in_2),
        .frames_in_3 (lock_frames_in_3),
        .frames_out_0(lock_frames_out_0),
        .frames_out_1(lock_frames_out_1),
        .frames_out_2(lock_frames_out_2),
        .frames_out_3(lock_frames_out_3)
    ) lock (
        .clk      (clk),
        .rst      (rst),
        .en       (en && (usable || r_state < SETTLE)),
        .enable   ({{2{r_state >= BALANCE}}, {2{r_state >= SETTLE}}}),
        .judged   (judged),
        .agc_error({2'd0, i_setpoint} - {1'b0, i_magnitude}),
        .setpoint (i_setpoint),
        .phase    (i_phase),
        .sense_sin(i_sense_sin),
        .sense_cos(i_sense_cos),
        .rail     (i_qsc_rail),
        .r_locked (r_lock_locked),
        .r_count_0(r_lock_count_0),
        .r_count_1(r_lock_count_1),
        .r_count_2(r_lock_count_2),
        .r_count_3(r_lock_count_3)
    );

    gyro_fault_monitor #(
        .over_range(faults_over_range),
        .stuck     (faults_stuck),
        .drive     (faults_drive),
        .rate      (faults_rate),
        .rail      (faults_rail),
        .top       (faults_top)
    ) faults (
        .clk          (clk),
        .rst          (rst),
        .en           (en),
        .armed        (r_state > INIT),
        .fresh        (fresh),
        .codes_0      (i_drive_sin),
        .codes_1      (i_drive_cos),
        .codes_2      (i_sense_sin),
        .codes_3      (i_sense_cos),
        .i_drive      (i_drive_saturated && r_state >= SETTLE),
        .i_rate       (i_rate_saturated),
        .i_rail       (i_qsc_rail && r_state >= BALANCE && !i_control[FIX_QSC]),
        .watch_stuck  (r_state >= SEARCH || (r_state == STANDBY && r_faults_flags[STUCK])),
        .levels       ({r_failed, 5'd0, r_lost, 1'b0}),
        .clear        (i_control[CLEAR_FAULTS] ? 8'hFF : i_clear),
        .r_codes_0    (r_faults_codes_0),
        .r_codes_1    (r_faults_codes_1),
        .r_codes_2    (r_faults_codes_2),
        .r_codes_3    (r_faults_codes_3),
        .r_over_range (r_faults_over_range),
        .r_stuck      (r_faults_stuck),
        .r_drive      (r_faults_drive),
        .r_rate       (r_faults_rate),
        .r_rail       (r_faults_rail),
        .r_bad_frames (r_faults_bad_frames),
        .r_good_frames(r_faults_good_frames),
        .r_flags      (r_faults_flags),
        .r_latch      (r_faults_latch)
    );

    // modes and flags: from the registers alone
    wire bad = r_faults_flags[STALE] || r_faults_flags[STUCK];
    wire balancing = (r_state >= BALANCE);
    always @* begin
        o_agc_mode = {1'b0, LOOP_OFF};
        o_pll_mode = LOOP_OFF;
        o_ftr_mode = LOOP_OFF;
        o_qsc_mode = LOOP_OFF;
        if (r_state == KICK)
            o_agc_mode = AGC_KICK;
        else if (r_state == ACQUIRE) begin
            // holding would keep the full force on: a bad frame switches the drive off
            if (!bad)
                o_agc_mode = {1'b0, r_control[HOLD_AGC] ? LOOP_HOLD : LOOP_P_ONLY};
        end else if (r_state > ACQUIRE)
            o_agc_mode = {1'b0, (bad || r_control[HOLD_AGC]) ? LOOP_HOLD : LOOP_RUN};
        if (r_state >= ACQUIRE)
            o_pll_mode = (bad || r_control[HOLD_PLL]) ? LOOP_HOLD : LOOP_RUN;
        if (balancing && !r_control[FIX_FTR])
            o_ftr_mode = (bad || r_control[HOLD_FTR]) ? LOOP_HOLD : LOOP_RUN;
        if (balancing && !r_control[FIX_QSC])
            o_qsc_mode = (bad || r_control[HOLD_QSC]) ? LOOP_HOLD : LOOP_RUN;
    end

    assign o_fix_drive = (r_state == OPEN);
    assign o_fix_ftr = (r_state == OPEN || balancing) && r_control[FIX_FTR];
    assign o_fix_qsc = (r_state == OPEN || balancing) && r_control[FIX_QSC];
    assign o_dac_init = (r_state == INIT);
    assign o_load = (r_state <= KICK);
    assign o_adjust = (r_state == RETUNE) && (r_timer == 16'd0);
    assign o_drive_locked = balancing;
    assign o_locked = (r_state == LOCKED);
    assign o_rate_good = o_locked && !(bad || r_faults_flags[OVER_RANGE] || r_faults_flags[RATE_SATURATED]);

endmodule
