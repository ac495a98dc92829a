// Core blocks of the firmware in the LOCKED state, register for register as in fpga_model/: names, widths, latencies.
// Left out: sequencer, lock and fault monitors, watchdog, register bank, digital SID, rate output.
// gyro_params.vh holds the constants of the configuration; gyro_state.vh loads the registers and shows them at the end.
// Arithmetic behind an enable is written inside it: as wires a simulator would evaluate it at every clock, in vain.
`timescale 1ns / 1ns

module rates (input clk, input go);
    reg [4:0] tick;
    reg [6:0] frame;
    reg [5:0] slot;
    always @(posedge clk) begin
        tick <= tick == 5'd25 ? 5'd0 : tick + 5'd1;
        if (tick == 5'd25) frame <= frame == 7'd124 ? 7'd0 : frame + 7'd1;
        if (go) slot <= 6'd1;
        else slot <= slot != 6'd0 && slot != 6'd60 ? slot + 6'd1 : 6'd0;
    end
endmodule

module dds (input clk, input [47:0] word);
    `include "gyro_params.vh"
    reg [47:0] phase, drive_sine, sense_sine, drive_ref, sense_ref;
    always @(posedge clk) begin
        phase <= phase + word;
        drive_sine <= phase + PHASE_DRIVE_SINE;
        sense_sine <= phase + PHASE_SENSE_SINE;
        drive_ref <= phase + PHASE_DRIVE_REF;
        sense_ref <= phase + PHASE_SENSE_REF;
    end
endmodule

module sine (input clk, input [47:0] phase);
    reg sign, sign2;
    reg [22:0] base, base2;
    reg [12:0] slope;
    reg [9:0] fraction;
    reg [23:0] product;
    reg signed [17:0] y;
    reg [35:0] rom [0:1023];
    initial $readmemh("sine.hex", rom);
    wire [19:0] place = phase[46] ? ~phase[45:26] : phase[45:26];
    wire [35:0] row = rom[place[19:10]];
    wire [32:0] sum = {base2, 10'd0} + {9'd0, product} + 33'd32768;
    wire signed [17:0] magnitude = {1'b0, sum[32:16]};
    always @(posedge clk) begin
        sign <= phase[47];
        base <= row[35:13];
        slope <= row[12:0];
        fraction <= place[9:0];
        sign2 <= sign;
        base2 <= base;
        product <= {11'd0, slope} * {13'd0, fraction, 1'b1};
        y <= sign2 ? -magnitude : magnitude;
    end
endmodule

module delay #(parameter DEPTH = 0) (input clk, input signed [17:0] x, output signed [17:0] out);
    reg signed [17:0] taps [0:7];
    generate
        if (DEPTH == 0) assign out = x;
        else begin
            assign out = taps[DEPTH - 1];
            integer k;
            always @(posedge clk) begin
                taps[0] <= x;
                for (k = 1; k < 8; k = k + 1) taps[k] <= taps[k - 1];
            end
        end
    endgenerate
endmodule

module references #(parameter ALIGN = 0, parameter RETIMED = 1) (
    input clk, input ce_1m, input [47:0] drive_ref, input [47:0] sense_ref, output [3:0] pins
);
    reg [3:0] signs, retimed;
    reg [3:0] aligned [0:2];
    wire [3:0] picked = ALIGN == 0 ? signs : aligned[ALIGN == 0 ? 0 : ALIGN - 1];
    assign pins = RETIMED != 0 ? retimed : picked;
    always @(posedge clk) begin
        signs <= {~(sense_ref[47] ^ sense_ref[46]), ~sense_ref[47], ~(drive_ref[47] ^ drive_ref[46]), ~drive_ref[47]};
        aligned[0] <= signs;
        aligned[1] <= aligned[0];
        aligned[2] <= aligned[1];
        if (ce_1m) retimed <= picked;
    end
endmodule

module modulator #(
    parameter SHIFT = 25, parameter signed [19:0] LO = 0, parameter signed [19:0] HI = 0, parameter FRAMES = 0
) (
    input clk, input en_product, input en_code, input signed [23:0] amplitude, input signed [17:0] sine,
    output signed [19:0] out
);
    reg signed [41:0] product;
    reg signed [19:0] code, held1, held2;
    reg signed [42:0] rounded;
    assign out = FRAMES == 2 ? held2 : FRAMES == 1 ? held1 : code;
    always @(posedge clk) begin
        if (en_product) product <= amplitude * sine;
        if (en_code) begin
            rounded = (product + (43'sd1 <<< (SHIFT - 1))) >>> SHIFT;
            code <= rounded < LO ? LO : rounded > HI ? HI : rounded[19:0];
            held1 <= code;
            held2 <= held1;
        end
    end
endmodule

module spi_dac #(parameter BITS = 24, parameter LEAD = 0, parameter LDAC = 0) (
    input clk, input load, input [23:0] word, output sdin
);
    reg [23:0] shift;
    reg [4:0] left;
    reg [1:0] lead;
    reg sync_n, sclk_en, ldac_n, ldac_wait;
    localparam [23:0] MASK = 24'hFFFFFF >> (24 - BITS);
    assign sdin = shift[BITS - 1];
    always @(posedge clk) begin
        ldac_n <= load | ~ldac_wait;
        ldac_wait <= 1'b0;
        if (load) begin
            shift <= word;
            left <= BITS;
            lead <= LEAD;
            sync_n <= 1'b0;
            sclk_en <= LEAD == 0;
        end else if (sclk_en) begin
            shift <= (shift << 1) & MASK;
            left <= left - 5'd1;
            if (left == 5'd1) begin
                sync_n <= 1'b1;
                sclk_en <= 1'b0;
                ldac_wait <= LDAC != 0;
            end
        end else if (lead != 2'd0) begin
            lead <= lead - 2'd1;
            sclk_en <= lead == 2'd1;
        end
    end
endmodule

module spi_adc (input clk, input drdy_n, input dout);
    reg meta, sync, seen, busy, cs_n, sclk, valid, ok;
    reg [5:0] count;
    reg [23:0] shift, status;
    reg [3:0] word;
    reg signed [23:0] channels [0:7];
    wire [23:0] next = {shift[22:0], dout};
    always @(posedge clk) begin
        meta <= drdy_n;
        sync <= meta;
        seen <= sync;
        valid <= 1'b0;
        if (busy) begin
            if (word == 4'd9) begin
                count <= count + 6'd1;
                if (count == 6'd53) begin
                    busy <= 1'b0;
                    count <= 6'd0;
                    cs_n <= 1'b1;
                    word <= 4'd0;
                end
            end else if (!sclk) sclk <= 1'b1;
            else begin
                sclk <= 1'b0;
                shift <= next;
                count <= count + 6'd1;
                if (count == 6'd23) begin
                    count <= 6'd0;
                    word <= word + 4'd1;
                    if (word == 4'd0) status <= next;
                    else channels[word[2:0] - 3'd1] <= next;
                    if (word == 4'd8) begin
                        valid <= 1'b1;
                        ok <= status[23:20] == 4'b1100;
                    end
                end
            end
        end else if (seen && !sync) begin
            busy <= 1'b1;
            cs_n <= 1'b0;
        end
    end
endmodule

module cordic (input clk, input ce, input start, input signed [23:0] x_in, input signed [23:0] y_in);
    reg [32:0] x;
    reg signed [32:0] y;
    reg signed [31:0] angle;
    reg [4:0] i;
    reg busy, done;
    reg [24:0] magnitude;
    reg signed [23:0] phase;
    reg [31:0] atan [0:31];
    initial $readmemh("atan.hex", atan);
    reg signed [34:0] half, across, down;
    reg signed [24:0] x_abs, y_turned;
    reg [32:0] turn;
    always @(posedge clk) if (ce) begin
        if (start) begin
            x_abs = x_in < 0 ? -$signed({x_in[23], x_in}) : x_in;
            y_turned = x_in < 0 ? -$signed({y_in[23], y_in}) : y_in;
            x <= {x_abs, 8'd0};
            y <= {y_turned, 8'd0};
            angle <= x_in < 0 ? 32'h80000000 : 32'd0;
            i <= 5'd0;
            busy <= 1'b1;
            done <= 1'b0;
        end else if (!busy) done <= 1'b0;
        else if (i < 5'd24) begin
            half = (35'sd1 <<< i) >>> 1;
            across = ($signed({{2{y[32]}}, y}) + half) >>> i;
            down = ($signed({2'b00, x}) + half) >>> i;
            x <= y < 0 ? x - across[32:0] : x + across[32:0];
            y <= y < 0 ? y + down[32:0] : y - down[32:0];
            angle <= y < 0 ? angle - atan[i] : angle + atan[i];
            i <= i + 5'd1;
        end else begin
            turn = {angle[31], angle} + 33'd128;
            busy <= 1'b0;
            done <= 1'b1;
            magnitude <= (x + 33'd128) >> 8;
            phase <= x == 33'd0 ? 24'd0 : turn[31:8];
        end
    end
endmodule

// mode RUN; products and sums of 64 bits hold everything exactly
module pi #(
    parameter signed [63:0] KP = 0, parameter signed [63:0] KI = 0,
    parameter signed [63:0] LO = 0, parameter signed [63:0] HI = 0
) (
    input clk, input ce, input en, input signed [25:0] e
);
    reg signed [59:0] prop, acc;
    reg signed [35:0] y;
    reg signed [63:0] error, gone, rounded;
    always @(posedge clk) if (ce) begin
        if (en) begin
            error = e;
            gone = acc + KI * error;
            prop <= KP * error;
            acc <= gone < (LO <<< 24) ? LO <<< 24 : gone > (HI <<< 24) ? HI <<< 24 : gone;
        end
        rounded = prop + acc + 64'sd8388608;
        rounded = rounded >>> 24;
        y <= rounded < LO ? LO : rounded > HI ? HI : rounded;
    end
endmodule

module isqrt (input clk, input ce, input start, input [31:0] u);
    reg [31:0] radicand;
    reg [15:0] root, y;
    reg [16:0] remainder;
    reg [3:0] i;
    reg busy, done;
    reg [18:0] pair, trial;
    reg fits;
    always @(posedge clk) if (ce) begin
        if (start) begin
            radicand <= u;
            root <= 16'd0;
            remainder <= 17'd0;
            i <= 4'd0;
            busy <= 1'b1;
            done <= 1'b0;
        end else if (!busy) done <= 1'b0;
        else begin
            pair = {remainder, radicand[31:30]};
            trial = {1'b0, root, 2'b01};
            fits = pair >= trial;
            radicand <= radicand << 2;
            root <= {root[14:0], fits};
            remainder <= fits ? pair - trial : pair;
            i <= i + 4'd1;
            busy <= i != 4'd15;
            done <= i == 4'd15;
            if (i == 4'd15) y <= {root[14:0], fits};
        end
    end
endmodule

module agc (input clk, input ce, input en, input en_pi, input [24:0] magnitude);
    `include "gyro_params.vh"
    reg signed [25:0] error;
    pi #(AGC_KP, AGC_KI, AGC_LO, AGC_HI) loop (clk, ce, en_pi, error);
    always @(posedge clk) if (ce && en) error <= SETPOINT - $signed({1'b0, magnitude});
endmodule

module frequency_tracker (input clk, input ce, input en, input en_pi, input signed [23:0] phase);
    `include "gyro_params.vh"
    reg signed [23:0] error;
    reg [47:0] centre, word;
    pi #(PLL_KP, PLL_KI, PLL_LO, PLL_HI) loop (clk, ce, en_pi, {{2{error[23]}}, error});
    always @(posedge clk) if (ce) begin
        if (en) error <= phase;
        word <= centre + {{12{loop.y[35]}}, loop.y};
    end
endmodule

module rate_loop (input clk, input ce, input en, input en_pi, input signed [23:0] sense_sin);
    `include "gyro_params.vh"
    reg signed [23:0] error;
    pi #(FTR_KP, FTR_KI, FTR_LO, FTR_HI) loop (clk, ce, en_pi, {{2{error[23]}}, error});
    always @(posedge clk) if (ce && en) error <= sense_sin;
endmodule

module quadrature_loop (input clk, input ce, input en, input en_pi, input en_root, input signed [23:0] sense_cos);
    `include "gyro_params.vh"
    reg signed [24:0] error;
    wire signed [24:0] wide = sense_cos;
    pi #(QSC_KP, QSC_KI, QSC_LO, QSC_HI) loop (clk, ce, en_pi, {error[24], error});
    isqrt root (clk, ce, en_root, loop.y[31:0]);
    always @(posedge clk) if (ce && en) error <= -wide;
endmodule

module control (
    input clk, input [5:0] slot, input signed [23:0] drive_sin, input signed [23:0] drive_cos,
    input signed [23:0] sense_sin, input signed [23:0] sense_cos
);
    wire ce = slot != 6'd0;
    wire at_loops = slot == 6'd32;
    wire at_pi = slot == 6'd33;
    wire signed [23:0] negated = drive_cos == 24'sh800000 ? 24'sh7FFFFF : -drive_cos;
    cordic cordic (clk, ce, slot == 6'd1, negated, drive_sin);
    agc agc (clk, ce, at_loops, at_pi, cordic.magnitude);
    frequency_tracker frequency_tracker (clk, ce, at_loops, at_pi, cordic.phase);
    rate_loop rate_loop (clk, ce, at_loops, at_pi, sense_sin);
    quadrature_loop quadrature_loop (clk, ce, at_loops, at_pi, slot == 6'd36, sense_cos);
endmodule

module gyro_core (
    input clk, input drdy_n, input dout,
    output adc_cs_n, output adc_sclk, output [3:0] refs,
    output drive_sync_n, output drive_sclk_en, output drive_sdin,
    output sense_sync_n, output sense_sclk_en, output sense_sdin, output sense_ldac_n,
    output quadrature_sync_n, output quadrature_sclk_en, output quadrature_sdin
);
    `include "gyro_params.vh"
    wire ce_1m = rates.tick == 5'd0;
    wire at_code = rates.tick == 5'd1;
    wire at_load = rates.tick == 5'd2;
    wire signed [17:0] drive_y, sense_y;
    wire signed [19:0] drive_code, sense_code;

    rates rates (clk, adc.valid);
    dds dds (clk, control.frequency_tracker.word);
    sine drive_sine (clk, dds.drive_sine);
    sine sense_sine (clk, dds.sense_sine);
    delay #(PIPE_DEPTH) drive_pipe (clk, drive_sine.y, drive_y);
    delay #(PIPE_DEPTH) sense_pipe (clk, sense_sine.y, sense_y);
    references #(REF_ALIGN, REF_RETIMED) references (clk, ce_1m, dds.drive_ref, dds.sense_ref, refs);
    modulator #(DRIVE_SHIFT, DRIVE_LO, DRIVE_HI, DRIVE_FRAMES) drive_modulator (
        clk, ce_1m, at_code, control.agc.loop.y[23:0], drive_y, drive_code);
    modulator #(SENSE_SHIFT, SENSE_LO, SENSE_HI, SENSE_FRAMES) sense_modulator (
        clk, ce_1m, at_code, control.rate_loop.loop.y[23:0], sense_y, sense_code);
    spi_dac #(16, 1, 0) drive_dac (clk, at_load, {8'd0, drive_code[15:0] ^ 16'h8000}, drive_sdin);
    spi_dac #(24, 0, 1) sense_dac (clk, at_load, {4'b0001, sense_code}, sense_sdin);
    spi_dac #(24, 0, 0) quadrature_dac (
        clk, at_load & rates.frame[0], {8'h08, control.quadrature_loop.root.y}, quadrature_sdin);
    spi_adc adc (clk, drdy_n, dout);
    control control (clk, rates.slot, adc.channels[0], adc.channels[1], adc.channels[2], adc.channels[3]);

    assign adc_cs_n = adc.cs_n;
    assign adc_sclk = adc.sclk;
    assign drive_sync_n = drive_dac.sync_n;
    assign drive_sclk_en = drive_dac.sclk_en;
    assign sense_sync_n = sense_dac.sync_n;
    assign sense_sclk_en = sense_dac.sclk_en;
    assign sense_ldac_n = sense_dac.ldac_n;
    assign quadrature_sync_n = quadrature_dac.sync_n;
    assign quadrature_sclk_en = quadrature_dac.sclk_en;

    `include "gyro_state.vh"
endmodule
