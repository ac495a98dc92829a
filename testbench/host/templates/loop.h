// The board with its port, verilated, closed around chips and plant: the RTL begins with the registers of state.hex.
#pragma once
#include "Vgyro_board.h"
#include "board.h"
#include "verilated.h"

struct Loop {
    Board board;
    VerilatedContext context;
    Vgyro_board top{&context};
    int at = 0;  // clock of the tick
    i64 now = 0;  // clocks

    explicit Loop(const char *state) {
        board.load(state);
        top.clk = top.rst = 0;
        top.drdy_n = board.drdy_n();
        top.dout = board.dout();
        top.eval();
    }

    ~Loop() { top.final(); }

    // One edge, with what stands at the pins of the port
    void clock() {
        if (at == 0) board.begin();
        top.drdy_n = board.drdy_n();
        top.dout = board.dout();
        top.clk = 1;
        top.eval();
        board.clock(top.o_adc_cs_n, top.o_adc_sclk, top.o_refs, top.o_drive_sync_n, top.o_drive_sclk_en, top.o_drive_sdin,
                    top.o_sense_sync_n, top.o_sense_sclk_en, top.o_sense_sdin, top.o_sense_ldac_n, top.o_quadrature_sync_n,
                    top.o_quadrature_sclk_en, top.o_quadrature_sdin);
        top.clk = 0;
        top.eval();
        now++;
        if (++at < TICK_CYCLES) return;
        at = 0;
        board.end();
        board.drive_codes.clear();  // nobody looks at them
        board.sense_codes.clear();
        board.frames.clear();
    }
};

// The only one: the port at rest
Loop &loop();
