/* The plant port: what a shared library exports to be the plant around the firmware. C99 or C++, no other file needed.

       cc -O2 -std=c99 -ffp-contract=off -shared -fPIC -I FOLDER_OF_THIS_FILE my_plant.c -o my_plant.so
       gyro run --plant ./my_plant.so

   A tick is 26 clocks of 26 MHz, 1 us; a frame is 125 ticks (the lines clock.* of the configuration say so).
   The firmware plays a tick first. The plant is then told what its pins did, and when. What the plant measures is seen
   by the firmware in a later tick. The host calls `step` for 1 to 128 ticks at once, all of one frame; where it cuts
   differs from run to run, so no result may depend on it. All integers are int64, all physical values SI doubles.

   The host calls    abi, keys, create, reset, then step again and again, destroy at the end.
   Failure           a function that returns int32 returns 0; for anything else the host prints gyro_plant_error and
                     ends the run. No function may print, exit or throw.
   Threads           one plant is used by one thread at a time; two plants may be used at once.
*/
#ifndef GYRO_PLANT_H
#define GYRO_PLANT_H

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define GYRO_PLANT_ABI 1

#if defined(_WIN32)
#define GYRO_EXPORT __declspec(dllexport)
#else
#define GYRO_EXPORT __attribute__((visibility("default")))
#endif

enum { GYRO_MOST_TICKS = 128, GYRO_MOST_EDGES = 1024, GYRO_CHANNELS = 5 };
enum { GYRO_DRIVE_SIN, GYRO_DRIVE_COS, GYRO_SENSE_SIN, GYRO_SENSE_COS, GYRO_TEMPERATURE };

/* What the pins did in the ticks of one call. */
typedef struct {
    int64_t tick;            /* the first of these ticks, counted from power-on */
    int64_t ticks;           /* 1 .. 128, all of one frame */
    int64_t drive_clock;     /* clock 0 .. 25 of each tick at which the drive DAC takes the code of that tick; */
    int64_t sense_clock;     /* -1: it takes none in this call, and the codes below are the one it has */
    int64_t quadrature_code; /* of the V_q DAC, 0 .. 65535, in force from the frame's first instant */
    int64_t edge_count;
    int64_t drive_code[GYRO_MOST_TICKS]; /* of each tick, at its end: 16 bit, signed */
    int64_t sense_code[GYRO_MOST_TICKS]; /* 20 bit, signed */
    int64_t edge[GYRO_MOST_EDGES][2];    /* clock from the first tick's first, and pin 0 .. 3 that changes its level;
                                            in time order. All pins are low at power-on. Pins as the channels:
                                            0 drive sgn(sin), 1 drive sgn(cos), 2 sense sgn(sin), 3 sense sgn(cos) */
} gyro_pins;

/* The converter after the last of these ticks.

   code  result register: 24 bit, signed. A conversion is in it before the tick begins in which its DRDY falls, and for
         32 ticks from there on
   drdy  clocks from the end of the call to the next two falls of DRDY, at least 800 clocks apart. They are promises:
         each later call counts the same instants down, until a fall lies in the ticks of the call. The first after
         power-on is at 26 or later. A record needs DRDY at the same clock of every frame but the first */
typedef struct {
    int64_t code[GYRO_CHANNELS];
    int64_t drdy[2];
} gyro_adc;

#ifdef __cplusplus
extern "C" {
#endif

/* GYRO_PLANT_ABI. The host refuses another one. */
GYRO_EXPORT int32_t gyro_plant_abi(void);

/* Keys of the configuration that this plant reads, separated by blanks: "plant.fx_hz plant.qx"; "plant.*" for all of a
   section. An effect that is switched on and not read is refused; other keys are printed as not seen by the plant. */
GYRO_EXPORT const char *gyro_plant_keys(void);

/* A new plant, or NULL and one line of text in `error`.
   configuration   lines "section.key = value" of [plant], [noise] and [effects], and clock.master_hz,
                   clock.tick_clocks, clock.frame_ticks; see gyro_number
   own             what the user hands over to the library alone (--plant-file), "" if nothing */
GYRO_EXPORT void *gyro_plant_create(const char *configuration, const char *own, char *error, int64_t error_size);
GYRO_EXPORT void gyro_plant_destroy(void *plant);

/* Power-on at tick 0: everything at rest, DAC outputs settled at these codes, all pins low. Fills `adc`, drdy counted
   from the first clock of tick 0. All that is random follows from `seed`. */
GYRO_EXPORT int32_t gyro_plant_reset(void *plant, int64_t seed, int64_t drive_code, int64_t sense_code,
                                     double temperature_degc, gyro_adc *adc);

/* These ticks, at this rate (rad/s) and temperature (degC), which change at frame borders only.
   motion   x (m), vx (m/s), y (m), vy (m/s) at the end, for the truth columns of a record; it may be left alone */
GYRO_EXPORT int32_t gyro_plant_step(void *plant, const gyro_pins *pins, double rate_rad_s, double temperature_degc,
                                    gyro_adc *adc, double motion[4]);

/* One line on the last failure of this plant. */
GYRO_EXPORT const char *gyro_plant_error(void *plant);

/* May be absent, all three: without them a run writes no checkpoint and no state. Bytes of everything that `step`
   depends on and that `create` does not make. */
GYRO_EXPORT int64_t gyro_plant_state_size(void *plant);
GYRO_EXPORT int32_t gyro_plant_save(void *plant, unsigned char *state);
GYRO_EXPORT int32_t gyro_plant_load(void *plant, const unsigned char *state);

#ifdef __cplusplus
}
#endif

/* A number of the configuration, or `otherwise` if it has no line of that key; true reads as 1, false as 0. */
static inline double gyro_number(const char *configuration, const char *key, double otherwise) {
    size_t length = strlen(key);
    for (const char *line = configuration; *line;) {
        if (!strncmp(line, key, length) && !strncmp(line + length, " = ", 3)) {
            const char *value = line + length + 3;
            return *value == 't' ? 1.0 : *value == 'f' ? 0.0 : strtod(value, NULL);
        }
        line = strchr(line, '\n');
        if (!line) break;
        line++;
    }
    return otherwise;
}

#endif
