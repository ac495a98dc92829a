`include "pi_defs.svh"
module pi_core import pi_types_pkg::*; #(
  parameter logic signed [33:0] KP = '0, parameter logic signed [33:0] KI = '0,
  parameter out_t LO = '0, parameter out_t HI = '0
) (
  input  logic clock, input logic reset_n, input logic strobe, input mode_t mode_i,
  input  logic signed [25:0] error_i, input out_t preset_i, output out_t word_o
);
  acc_t prop, acc;
  localparam acc_t ACC_LO = acc_t'(LO) <<< `PI_FRAC, ACC_HI = acc_t'(HI) <<< `PI_FRAC;
  acc_t kp_e, ki_e, pre;
  assign kp_e = KP * error_i;
  assign ki_e = KI * error_i;
  assign pre = acc_t'(preset_i) <<< `PI_FRAC;
  logic signed [61:0] sum;
  logic signed [37:0] rounded;
  assign sum = 62'(prop) + 62'(acc) + 62'sd8388608;
  assign rounded = 38'(sum >>> `PI_FRAC);
  always_ff @(posedge clock or negedge reset_n)
    if (!reset_n) begin
      prop <= '0; acc <= '0; word_o <= '0;
    end else begin
      word_o <= rounded < 38'(LO) ? LO : rounded > 38'(HI) ? HI : out_t'(rounded);
      if (strobe) begin
        case (mode_i)
          OFF: begin prop <= '0; acc <= clamp_acc(61'(pre), ACC_LO, ACC_HI); end
          P_ONLY: prop <= kp_e;
          RUN: begin prop <= kp_e; acc <= clamp_acc(61'(acc) + 61'(ki_e), ACC_LO, ACC_HI); end
          default: ;
        endcase
      end
    end
endmodule
