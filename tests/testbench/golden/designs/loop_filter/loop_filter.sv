`include "loop_defs.svh"
module loop_filter
  import fx_pkg::*;
  import pi_types::*;
#(parameter gain_t KP = '0, parameter gain_t KI = '0,
  parameter word_t FLOOR = '0, parameter word_t CEIL = '0) (
    input  logic                  clk_i, arst_i,
    input  logic [`CTL_BITS-1:0]  ctl_i,      // {valid, mode, preset}
    input  logic [31:0]           err_i,      // sign-extended by the bus
    output logic signed [35:0]    act_o
);
  localparam logic signed [61:0] LO = 62'(widen(FLOOR));
  localparam logic signed [61:0] HI = 62'(widen(CEIL));

  ctl_t  ctl, ctl_q;
  wide_t p, i, prop_q, acc_q;
  assign ctl = ctl_i;
  gain_stage #(.KP(KP), .KI(KI)) u_gain (.clk_i, .arst_i, .ctl_i(ctl), .err_i(err_i[25:0]), .ctl_o(ctl_q), .p_o(p), .i_o(i));

  always_ff @(posedge clk_i or posedge arst_i)
    if (arst_i) begin
      prop_q <= '0;
      acc_q  <= '0;
    end else if (ctl_q.valid)
      unique case (ctl_q.mode)
        M_OFF:  begin prop_q <= '0; acc_q <= wide_t'(limit(62'(widen(ctl_q.preset)), LO, HI)); end
        M_PROP: prop_q <= p;
        M_RUN:  begin prop_q <= p; acc_q <= wide_t'(limit(62'(acc_q) + 62'(i), LO, HI)); end
        default: ;
      endcase

  logic signed [61:0] sum, rounded;
  assign sum     = 62'(prop_q) + 62'(acc_q) + 62'sd8388608;
  assign rounded = sum >>> FRAC;
  always_ff @(posedge clk_i or posedge arst_i)
    if (arst_i) act_o <= '0;
    else        act_o <= word_t'(limit(rounded, 62'(FLOOR), 62'(CEIL)));
endmodule
