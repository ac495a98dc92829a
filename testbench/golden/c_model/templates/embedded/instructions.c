/* Instructions of a frame on a Cortex-M, counted by QEMU: with -icount shift=0 an instruction takes 1 ns, so that the
   system timer counts instructions. What it counts is measured first, on a loop of known length. */
#include <stdint.h>

#include "adc_serial.h"
#include "blocks.h"
#include "firmware.h"

enum { FRAMES = 16, LOOPS = 1000000, FRAME_CLOCKS = GYRO_DESIGN_TICK_CLOCKS * GYRO_DESIGN_FRAME_TICKS };

#define TIMER ((volatile uint32_t *)0xE000E010) /* control, reload, current */

void start(void);
extern uint32_t stack_top, data_source, data_begin, data_end, bss_begin, bss_end;
__attribute__((section(".vectors"), used)) static const void *const vectors[2] = {&stack_top, (const void *)start};

static void host(int operation, const void *argument) {
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

static void print(const char *before, uint64_t number, const char *after) {
    char text[21], *at = text + sizeof text - 1;
    *at = 0;
    do *--at = (char)('0' + number % 10);
    while (number /= 10);
    host(4, before);
    host(4, at);
    host(4, after);
}

static uint32_t timer(void) { return TIMER[2]; }

/* A subtraction and a branch each */
static void loop(int32_t n) {
    __asm__ volatile("1: subs %0, %0, #1\n bne 1b" : "+r"(n) : : "cc");
}

/* The inputs of a frame, by a converter that sends codes in the middle of its range; bit 0 DRDY_N, bit 1 DOUT */
static void frame(gyro_adc_serial_State *chip, int64_t number, uint8_t *given) {
    for (int k = 0; k < FRAME_CLOCKS; k++) {
        int64_t codes[8] = {1000 + number % 2, -1000 - number % 2, 500, -500 + number % 2, 0};
        gyro_adc_serial_State after;
        gyro_inputs.drdy_n = chip->drdy_n;
        gyro_inputs.dout = chip->out;
        given[k] = (uint8_t)(chip->drdy_n | chip->out << 1);
        gyro_clock();
        gyro_adc_serial_step(GYRO_DESIGN_ADC_WORD_BITS, chip, gyro_pins.adc_cs_n, gyro_pins.adc_sclk, k == 5, 0xC00000,
                             codes, &after);
        *chip = after;
    }
}

static gyro_top_State kept, behind;
static uint8_t given[FRAME_CLOCKS];

static void replay(void) {
    for (int k = 0; k < FRAME_CLOCKS; k++) {
        gyro_inputs.drdy_n = given[k] & 1;
        gyro_inputs.dout = given[k] >> 1;
        gyro_clock();
    }
}

void start(void) {
    for (uint32_t *from = &data_source, *to = &data_begin; to < &data_end;) *to++ = *from++;
    for (uint32_t *to = &bss_begin; to < &bss_end;) *to++ = 0;
    const gyro_block *top = gyro_block_named("top");
    gyro_adc_serial_State chip = {0};
    memcpy(&gyro_params, top->nominal, sizeof gyro_params);
    gyro_reset(top, (int64_t *)&gyro_state[0]);
    chip.cs_n = chip.drdy_n = 1;
    for (int64_t n = 0; n < FRAMES; n++) {
        kept = gyro_state[gyro_now];
        frame(&chip, n, given);
    }
    behind = gyro_state[gyro_now];
    TIMER[1] = 0xFFFFFF;
    TIMER[0] = 5;
    uint32_t began = timer();
    loop(LOOPS);
    uint64_t spent = (began - timer()) & 0xFFFFFF;
    gyro_state[gyro_now] = kept;
    began = timer();
    replay();
    uint64_t ticks = (began - timer()) & 0xFFFFFF, per_frame = ticks * 2 * LOOPS / spent;
    if (memcmp(&gyro_state[gyro_now], &behind, sizeof behind))
        host(4, "the frame that was counted is another one\n");
    else {
        print("", per_frame, " instructions per frame\n");
        print("", per_frame / FRAME_CLOCKS, " instructions per clock\n");
    }
    host(0x18, (const void *)0x20026);
}
