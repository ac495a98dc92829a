`define CTL_BITS 39
