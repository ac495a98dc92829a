// Arithmetic of the loop filter, widths of its buses.
package fx_pkg;
  localparam int FRAC = 24;
  typedef logic signed [35:0] word_t;     // integers
  typedef logic signed [59:0] wide_t;     // with FRAC fraction bits
  typedef logic signed [33:0] gain_t;
  typedef logic signed [25:0] err_t;

  function automatic wide_t widen(word_t w);
    return wide_t'(w) <<< FRAC;
  endfunction

  function automatic logic signed [61:0] limit(logic signed [61:0] v, logic signed [61:0] lo, logic signed [61:0] hi);
    return (v < lo) ? lo : (v > hi) ? hi : v;
  endfunction
endpackage
