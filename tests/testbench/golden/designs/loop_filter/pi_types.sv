package pi_types;
  import fx_pkg::*;
  typedef enum logic [1:0] {M_OFF, M_PROP, M_RUN, M_HOLD} mode_e;
  typedef struct packed {
    logic  valid;
    mode_e mode;
    word_t preset;
  } ctl_t;
endpackage
