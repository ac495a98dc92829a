package pi_types_pkg;
  typedef enum logic [1:0] {OFF = 2'd0, P_ONLY = 2'd1, RUN = 2'd2, HOLD = 2'd3} mode_t;
  typedef logic signed [59:0] acc_t;
  typedef logic signed [35:0] out_t;
  function automatic acc_t clamp_acc(input logic signed [60:0] x, input acc_t lo, input acc_t hi);
    if (x < 61'(lo)) return lo;
    if (x > 61'(hi)) return hi;
    return acc_t'(x);
  endfunction
endpackage
