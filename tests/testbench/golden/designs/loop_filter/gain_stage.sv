// Both products, registered, with the controls that belong to them.
module gain_stage
  import fx_pkg::*;
  import pi_types::*;
#(parameter gain_t KP = '0, parameter gain_t KI = '0) (
    input  logic  clk_i, arst_i,
    input  ctl_t  ctl_i,
    input  err_t  err_i,
    output ctl_t  ctl_o,
    output wide_t p_o, i_o
);
  always_ff @(posedge clk_i or posedge arst_i)
    if (arst_i) begin
      ctl_o <= '0;
      p_o   <= '0;
      i_o   <= '0;
    end else begin
      ctl_o <= ctl_i;
      p_o   <= wide_t'(KP) * wide_t'(err_i);
      i_o   <= wide_t'(KI) * wide_t'(err_i);
    end
endmodule
