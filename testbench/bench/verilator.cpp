// The RTL, verilated, closed around the board.     usage: Vgyro_core STATE TICKS CODES, in the folder of the .hex files
#include "Vgyro_core.h"
#include "board.h"
#include "verilated.h"

int main(int count, char **argument) {
    if (count != 4) fail("usage: Vgyro_core STATE TICKS CODES");
    static Board board;
    std::vector<i64> core;
    board.load(argument[1], core);
    VerilatedContext context;
    Vgyro_core *const top = new Vgyro_core(&context);
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
            board.clock(top->adc_cs_n, top->adc_sclk, top->refs, top->drive_sync_n, top->drive_sclk_en, top->drive_sdin,
                        top->sense_sync_n, top->sense_sclk_en, top->sense_sdin, top->sense_ldac_n,
                        top->quadrature_sync_n, top->quadrature_sclk_en, top->quadrature_sdin);
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
