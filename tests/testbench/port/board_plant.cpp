// The plant of testbench/bench behind the port. `own` is the path of a state that peers.export has written.
#include "gyro_plant.h"

#include "board.h"

static const double W_RAD_PER_S = 2 * M_PI * 11000;

struct Plant {
    Board board;
    std::vector<char> path;
};

// Clocks to the next conversion that is ready, and to `later` conversions behind it.
static i64 clocks_to_ready(const Board &b, i64 later) {
    const i64 NOT_PENDING = -((i64)1 << 61), CLOCK = (i64)1 << 32;
    bool waits = b.pending != NOT_PENDING;
    i64 ahead = waits ? later - 1 : later;
    i64 at = waits && !later ? b.pending : b.due + (b.decimation * (ahead + 1) - 1 - b.sample) * b.period + b.delay;
    return (at + CLOCK - 1) / CLOCK;
}

static void show(const Board &b, gyro_adc *adc) {
    for (int k = 0; k < CHANNELS; k++) adc->code[k] = b.adc_codes[k];
    adc->drdy[0] = b.drdy_cycle >= 0 ? b.drdy_cycle : clocks_to_ready(b, 0);
    adc->drdy[1] = b.drdy_cycle >= 0 ? clocks_to_ready(b, 0) : clocks_to_ready(b, 1);
}

int32_t gyro_plant_abi(void) { return GYRO_PLANT_ABI; }
const char *gyro_plant_keys(void) { return "plant.* noise.*"; }
const char *gyro_plant_error(void *) { return ""; }

void *gyro_plant_create(const char *, const char *own, char *, int64_t) {
    Plant *p = new Plant();
    p->path.assign(own, own + std::strlen(own) + 1);
    return p;
}

void gyro_plant_destroy(void *plant) { delete (Plant *)plant; }

int32_t gyro_plant_reset(void *plant, int64_t, int64_t, int64_t, double, gyro_adc *adc) {
    Plant *p = (Plant *)plant;
    p->board.load(p->path.data());
    show(p->board, adc);
    return 0;
}

int32_t gyro_plant_step(void *plant, const gyro_pins *pins, double rate_rad_s, double, gyro_adc *adc, double *motion) {
    Board &b = ((Plant *)plant)->board;
    int64_t k = 0;
    for (int64_t t = 0; t < pins->ticks; t++) {
        b.rate = rate_rad_s;
        b.quadrature.code = (int)pins->quadrature_code;
        b.begin();
        b.drive.code = (int)pins->drive_code[t];
        b.sense.code = (int)pins->sense_code[t];
        b.drive_cycle = (int)pins->drive_clock;
        b.sense_cycle = (int)pins->sense_clock;
        for (; k < pins->edge_count && pins->edge[k][0] < TICK_CYCLES * (t + 1); k++) {
            b.edge[b.edge_count][0] = (int)(pins->edge[k][0] - TICK_CYCLES * t);
            b.edge[b.edge_count++][1] = (int)pins->edge[k][1];
        }
        b.end();
    }
    b.drive_codes.clear();
    b.sense_codes.clear();
    b.frames.clear();
    show(b, adc);
    // velocities of this plant are in m, at its reference frequency
    for (int m = 0; m < 4; m++) motion[m] = (m % 2 ? W_RAD_PER_S : 1.0) * b.z[6 + m];
    return 0;
}
