// The RTL, verilated, closed around the board.     usage: Vgyro_board STATE TICKS CODES, in the folder of the .hex files
#include "Vgyro_board.h"
#include "board.h"
#include "verilated.h"

int main(int count, char **argument) {
    if (count != 4) fail("usage: Vgyro_board STATE TICKS CODES");
    static Board board;
    board.load(argument[1]);
    VerilatedContext context;
    Vgyro_board *const top = new Vgyro_board(&context);
    top->clk = 0;
    top->drdy_n = board.drdy_n();
    top->dout = board.dout();
    top->eval();
    i64 ticks = std::atoll(argument[2]);
    board.drive_codes.reserve(ticks);
    board.sense_codes.reserve(ticks);
    double began = cpu_s();
    for (i64 k = 0; k < ticks; k++) {
        board.begin();
        for (int c = 0; c < TICK_CYCLES; c++) {
            top->drdy_n = board.drdy_n();
            top->dout = board.dout();
            top->clk = 1;
            top->eval();
            board.clock(top->o_adc_cs_n, top->o_adc_sclk, top->o_refs, top->o_drive_sync_n, top->o_drive_sclk_en,
                        top->o_drive_sdin, top->o_sense_sync_n, top->o_sense_sclk_en, top->o_sense_sdin,
                        top->o_sense_ldac_n, top->o_quadrature_sync_n, top->o_quadrature_sclk_en,
                        top->o_quadrature_sdin);
            top->clk = 0;
            top->eval();
        }
        board.end();
    }
    board.write(argument[3], cpu_s() - began);
    top->final();
    delete top;
    return 0;
}
