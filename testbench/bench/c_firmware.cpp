// The firmware in C closed around the board.   usage: c_firmware STATE TICKS CODES, in the folder of the .hex files
extern "C" {
#include "blocks.h"
}
#include "top.h"
#include "board.h"

// Registers of the design from state.hex, two's complement in the width of each
static void load(const gyro_block *top, int64_t *row) {
    FILE *file = std::fopen("state.hex", "r");
    if (!file) fail("cannot read state.hex");
    for (size_t k = 0; k < top->registers.count; k++) {
        unsigned long long word;
        if (std::fscanf(file, "%llx", &word) != 1) fail("state.hex is too short");
        const gyro_port &port = top->registers.port[k];
        row[k] = (int64_t)word;
        if (port.is_signed && word >> (port.width - 1)) row[k] -= (int64_t)1 << port.width;
    }
    std::fclose(file);
}

int main(int count, char **argument) {
    if (count != 4) fail("usage: c_firmware STATE TICKS CODES");
    static Board board;
    board.load(argument[1]);
    const gyro_block *top = gyro_block_named("top");
    static gyro_top_State state[2];
    static gyro_top_Params p;
    int64_t row[sizeof state[0] / sizeof(int64_t)];
    load(top, row);
    std::memcpy(&state[0], row, sizeof row);
    std::memcpy(&p, top->nominal, sizeof p);
    gyro_top_Inputs in = {};
    i64 ticks = std::atoll(argument[2]);
    board.drive_codes.reserve(ticks);
    board.sense_codes.reserve(ticks);
    double began = cpu_s();
    int now = 0;
    for (i64 k = 0; k < ticks; k++) {
        board.begin();
        for (int c = 0; c < TICK_CYCLES; c++, now ^= 1) {
            in.drdy_n = board.drdy_n();
            in.dout = board.dout();
            gyro_top_step(&p, &state[now], &in, &state[now ^ 1]);
            gyro_top_Pins o;
            gyro_top_pins(&p, &state[now ^ 1], &o);
            board.clock((int)o.adc_cs_n, (int)o.adc_sclk, (int)o.refs, (int)o.drive_sync_n, (int)o.drive_sclk_en, (int)o.drive_sdin,
                        (int)o.sense_sync_n, (int)o.sense_sclk_en, (int)o.sense_sdin, (int)o.sense_ldac_n,
                        (int)o.quadrature_sync_n, (int)o.quadrature_sclk_en, (int)o.quadrature_sdin);
        }
        board.end();
    }
    board.write(argument[3], cpu_s() - began);
    std::memcpy(row, &state[now], sizeof row);
    for (size_t k = 0; k < top->registers.count; k++) std::printf("register %zu %lld\n", k, (long long)row[k]);
    return 0;
}
