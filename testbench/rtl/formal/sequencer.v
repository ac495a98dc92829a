// Properties of gyro_sequencer: nothing is switched on before what it needs, and whatever is wrong switches off.
module prove_sequencer #(
    parameter [15:0] offline = 16'd0,
    parameter [15:0] recover = 16'd0
) (
    input wire clk,
    input wire rst,
    input wire en,
    input wire [8:0] i_control,
    input wire [3:0] r_state,
    input wire [15:0] r_timer,
    input wire [3:0] r_lock_locked,
    input wire [15:0] r_faults_bad_frames,
    input wire [15:0] r_faults_good_frames,
    input wire [7:0] r_faults_flags,
    input wire [2:0] o_agc_mode,
    input wire [1:0] o_pll_mode,
    input wire [1:0] o_ftr_mode,
    input wire [1:0] o_qsc_mode,
    input wire o_dac_init,
    input wire o_rate_good
);

    localparam [3:0] POWER_UP = 4'd0, INIT = 4'd1, IDLE = 4'd2, STANDBY = 4'd3, OPEN = 4'd4, KICK = 4'd5,
                     SEARCH = 4'd7, RETUNE = 4'd8, ACQUIRE = 4'd9, SETTLE = 4'd10, BALANCE = 4'd11, LOCKED = 4'd12;
    localparam RUN = 0, HOLD_FTR = 3, HOLD_QSC = 4, FIX_FTR = 5, FIX_QSC = 6, OPEN_DRIVE = 7;
    localparam [1:0] LOOP_OFF = 2'd0, LOOP_HOLD = 2'd3;

    reg begun = 1'b0;
    reg was_rst, was_en;
    reg [3:0] was_state, was_locked;
    reg [8:0] was_control;
    reg [15:0] was_timer, was_good, was_bad;
    always @(posedge clk) begin
        begun       <= 1'b1;
        was_rst     <= rst;
        was_en      <= en;
        was_state   <= r_state;
        was_locked  <= r_lock_locked;
        was_control <= i_control;
        was_timer   <= r_timer;
        was_good    <= r_faults_good_frames;
        was_bad     <= r_faults_bad_frames;
    end

    wire stepped = was_en && !was_rst;
    wire started = was_state > INIT;
    wire entered = stepped && r_state != was_state;
    wire ftr_judged = !(was_control[HOLD_FTR] || was_control[FIX_FTR]);
    wire qsc_judged = !(was_control[HOLD_QSC] || was_control[FIX_QSC]);

    always @* begin
        if (!begun)
            assume (rst);
        else begin
            states_exist: assert (r_state <= LOCKED);
            resets: assert (!was_rst || (r_state == POWER_UP && r_timer == 16'd0));
            waits_for_enable: assert (was_rst || was_en || (r_state == was_state && r_timer == was_timer));
            // order of power-on
            init_after_power_up: assert (!(entered && r_state == INIT) || was_state == POWER_UP);
            never_back_to_power_up: assert (!(entered && r_state == POWER_UP));
            idle_before_drive: assert (!(stepped && !started && r_state > IDLE));
            // the user's stop, and the frames that a start needs
            stop_is_obeyed: assert (!(stepped && started && !was_control[RUN]) || r_state == IDLE);
            open_on_request_only: assert (!(entered && r_state == OPEN) || was_control[OPEN_DRIVE]);
            bad_frames_switch_off: assert (!(stepped && was_state >= KICK && was_bad >= offline) || r_state < KICK);
            first_kick_after_good_frames: assert (!(entered && r_state == KICK && was_state == STANDBY)
                                                  || was_good >= recover);
            // each state from its predecessor
            acquire_after_retune: assert (!(entered && r_state == ACQUIRE) || was_state == RETUNE);
            retune_after_search: assert (!(entered && r_state == RETUNE) || was_state == SEARCH);
            settle_after_acquire: assert (!(entered && r_state == SETTLE) || was_state == ACQUIRE);
            balance_needs_drive: assert (!(entered && r_state == BALANCE) || was_state == SETTLE || was_state == LOCKED);
            locked_after_balance: assert (!(entered && r_state == LOCKED) || was_state == BALANCE);
            locked_needs_sense: assert (!(stepped && r_state == LOCKED)
                                        || ((was_locked[2] || !ftr_judged) && (was_locked[3] || !qsc_judged)));
            // what each state switches on
            no_drive_before_kick: assert (r_state >= KICK || o_agc_mode == 3'd0);
            no_tracking_before_acquire: assert (r_state >= ACQUIRE || o_pll_mode == LOOP_OFF);
            no_force_before_balance: assert (r_state >= BALANCE || o_ftr_mode == LOOP_OFF);
            no_quadrature_before_balance: assert (r_state >= BALANCE || o_qsc_mode == LOOP_OFF);
            stale_loops_hold: assert (!r_faults_flags[2] || ((o_pll_mode == LOOP_OFF || o_pll_mode == LOOP_HOLD)
                                      && (o_ftr_mode == LOOP_OFF || o_ftr_mode == LOOP_HOLD)
                                      && (o_qsc_mode == LOOP_OFF || o_qsc_mode == LOOP_HOLD)));
            init_words_in_init: assert (o_dac_init == (r_state == INIT));
            good_only_locked: assert (!o_rate_good || (r_state == LOCKED && !r_faults_flags[2] && !r_faults_flags[0]));
        end
    end

endmodule
