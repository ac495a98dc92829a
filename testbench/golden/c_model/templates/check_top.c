/* The whole firmware on a recording: what crosses the pins comes from adc.hex, host.hex and sar.hex. */
#include <inttypes.h>
#include <string.h>

#include "adc_serial.h"
#include "check.h"
#include "top.h"

enum { CLOCK = 32, NEVER = -1 };

/* Words sorted by clock, of which the first is looked at */
typedef struct {
    words file;
    int64_t at;
} events;

static int open_events(events *e, const bundle *b, const char *name, int width) {
    e->at = NEVER;
    return words_open(&e->file, b, name, width);
}

static void next_event(events *e) {
    e->at = words_read(&e->file) == 1 ? words_bits(&e->file, e->file.width - CLOCK, CLOCK, 0) : NEVER;
}

/* ---- signature: remainder modulo x^64 + x^4 + x^3 + x + 1 of all rows of a frame, each with zeros in front ---- */

enum { MOST_WORDS = 256 };

static void pack(uint64_t *packed, const int64_t *row, gyro_ports ports, int *top) {
    for (size_t k = 0; k < ports.count; k++) {
        int width = ports.port[k].width;
        *top -= width;
        uint64_t value = (uint64_t)row[k] & ((UINT64_C(1) << width) - 1);
        int word = *top / 64, up = *top % 64;
        packed[word] |= value << up;
        if (up + width > 64) packed[word + 1] |= value >> (64 - up);
    }
}

static uint64_t taps(uint64_t x) { return x ^ x << 1 ^ x << 3 ^ x << 4; }

static uint64_t append(uint64_t sig, const int64_t *registers, const int64_t *pins, const gyro_block *b, int width) {
    uint64_t packed[MOST_WORDS] = {0};
    int top = width;
    pack(packed, registers, b->registers, &top);
    pack(packed, pins, b->pins, &top);
    for (int k = (width + 63) / 64 - 1; k >= 0; k--)
        sig = taps(sig) ^ taps(sig >> 63 ^ sig >> 61 ^ sig >> 60) ^ packed[k];
    return sig;
}

/* ---- the replay ---- */

typedef struct {
    events at, adc, host;
    words stim, exp, sig, sar;
} files;

static int open_all(files *f, const bundle *b, int in_width, int out_width) {
    return open_events(&f->at, b, "at", CLOCK) && open_events(&f->adc, b, "adc", CLOCK + 24 * 9) &&
           open_events(&f->host, b, "host", CLOCK + 4 + 8 + 48) && words_open(&f->stim, b, "stim", in_width) &&
           words_open(&f->exp, b, "exp", out_width) && words_open(&f->sig, b, "sig", 64) &&
           words_open(&f->sar, b, "sar", 36);
}

static void close_all(files *f) {
    words_close(&f->at.file);
    words_close(&f->adc.file);
    words_close(&f->host.file);
    words_close(&f->stim);
    words_close(&f->exp);
    words_close(&f->sig);
    words_close(&f->sar);
}

/* What a clock drives: host events and samples; 1 if it is a reset */
static int drive(files *f, int64_t n, gyro_top_Inputs *in) {
    if (n % GYRO_DESIGN_TICK_CLOCKS == 0 && words_read(&f->sar) == 1) {
        in->sample_x = words_bits(&f->sar, 18, 18, 1);
        in->sample_y = words_bits(&f->sar, 0, 18, 1);
    }
    in->write = 0;
    if (f->host.at != n) return 0;
    int rst = words_bits(&f->host.file, 56, 4, 0) == 1;
    if (!rst) {
        in->write = 1;
        in->address = words_bits(&f->host.file, 48, 8, 0);
        in->data = words_bits(&f->host.file, 0, 48, 0);
    }
    next_event(&f->host);
    return rst;
}

/* The converter behind an edge, with the pins as they are then */
static void convert(files *f, int64_t n, const gyro_top_State *s, gyro_adc_serial_State *chip) {
    int64_t codes[8] = {0}, status = 0, loaded = f->adc.at == n;
    if (loaded) {
        status = words_bits(&f->adc.file, 192, 24, 0);
        for (int k = 0; k < 8; k++) codes[k] = words_bits(&f->adc.file, 168 - 24 * k, 24, 1);
        next_event(&f->adc);
    }
    gyro_adc_serial_State after;
    gyro_adc_serial_step(GYRO_DESIGN_ADC_WORD_BITS, chip, s->adc.cs_n, s->adc.sclk, loaded, status, codes, &after);
    *chip = after;
}

static int compare_row(tally *t, files *f, const gyro_block *k, int64_t n, int rst, const gyro_top_Inputs *in,
                       const int64_t *registers, const int64_t *pins) {
    int64_t want_in[MOST_PORTS], want[MOST_PORTS], want_pins[MOST_PORTS], given[sizeof *in / sizeof(int64_t)];
    if (words_read(&f->stim) != 1 || words_read(&f->exp) != 1) return 0;
    memcpy(given, in, sizeof given);
    words_ports(&f->stim, k->inputs, f->stim.width - 1, want_in);
    words_ports(&f->exp, k->pins, words_ports(&f->exp, k->registers, f->exp.width, want), want_pins);
    int differs = compare(t, "clock", n, k->inputs, 'i', want_in, given, NULL);
    differs |= words_bits(&f->stim, f->stim.width - 1, 1, 0) != rst;
    differs |= compare(t, "clock", n, k->registers, 'r', want, registers, NULL);
    differs |= compare(t, "clock", n, k->pins, 'o', want_pins, pins, NULL);
    if (differs && t->bad++ == 0) t->first = n;
    t->rows++;
    next_event(&f->at);
    return 1;
}

static int compare_frame(tally *t, files *f, int64_t frame, uint64_t sig) {
    if (words_read(&f->sig) != 1) return 0;
    uint64_t want = (uint64_t)words_bits(&f->sig, 32, 32, 0) << 32 | (uint64_t)words_bits(&f->sig, 0, 32, 0);
    if (sig != want) {
        if (t->bad < SHOWN)
            printf("frame %" PRId64 ": signature: expected %016" PRIx64 ", got %016" PRIx64 " [c]\n", frame, want, sig);
        if (t->bad++ == 0) t->first = frame;
    }
    t->rows++;
    return 1;
}

static int run(const bundle *b, files *f, int64_t frames, tally *rows, tally *signatures) {
    const gyro_block *k = b->block;
    gyro_top_Params p;
    gyro_top_State s[2];
    gyro_top_Inputs in = {0};
    gyro_top_Pins out;
    gyro_adc_serial_State chip = {0};
    int64_t registers[sizeof s[0] / sizeof(int64_t)], pins[sizeof out / sizeof(int64_t)];
    int64_t frame_clocks = GYRO_DESIGN_TICK_CLOCKS * GYRO_DESIGN_FRAME_TICKS, now = 0;
    uint64_t sig = 0;
    memcpy(&p, b->params, sizeof p);
    gyro_reset(k, registers);
    memcpy(&s[0], registers, sizeof s[0]);
    chip.cs_n = chip.drdy_n = 1;
    next_event(&f->at);
    next_event(&f->adc);
    next_event(&f->host);
    for (int64_t n = 0; n < frames * frame_clocks; n++, now ^= 1) {
        int rst = drive(f, n, &in);
        in.drdy_n = chip.drdy_n;
        in.dout = chip.out;
        gyro_top_pins(&p, &s[now], &out);
        memcpy(registers, &s[now], sizeof registers);
        memcpy(pins, &out, sizeof pins);
        sig = append(sig, registers, pins, k, f->exp.width);
        if (f->at.at == n && !compare_row(rows, f, k, n, rst, &in, registers, pins)) return 0;
        gyro_top_step(&p, &s[now], &in, &s[now ^ 1]);
        if (rst) {
            gyro_reset(k, registers);
            memcpy(&s[now ^ 1], registers, sizeof registers);
        }
        convert(f, n, &s[now ^ 1], &chip);
        if ((n + 1) % frame_clocks == 0) {
            if (!compare_frame(signatures, f, n / frame_clocks, sig)) return 0;
            sig = 0;
        }
    }
    return 1;
}

int check_top(const bundle *b, int64_t frames) {
    const gyro_block *k = b->block;
    int64_t all = bundle_number(b, "frames");
    frames = frames > 0 && frames < all ? frames : all;
    files f = {0};
    tally rows = {0, 0, 0}, signatures = {0, 0, 0};
    int whole = open_all(&f, b, 1 + width_of(k->inputs), width_of(k->registers) + width_of(k->pins)) &&
                run(b, &f, frames, &rows, &signatures);
    close_all(&f);
    if (!whole) {
        fprintf(stderr, "%s: a .hex file does not hold what the manifest says\n", b->folder);
        return 2;
    }
    if (rows.bad || signatures.bad)
        printf("FAIL %s: %" PRId64 " of %" PRId64 " rows differ, the first is at clock %" PRId64 "; %" PRId64
               " of %" PRId64 " frames differ, the first is %" PRId64 " [c]\n",
               b->title, rows.bad, rows.rows, rows.first, signatures.bad, frames, signatures.first);
    else
        printf("PASS %s: %" PRId64 " clocks, %" PRId64 " rows of %zu ports, %" PRId64 " of %" PRId64 " frames [c]\n",
               b->title, frames * GYRO_DESIGN_TICK_CLOCKS * GYRO_DESIGN_FRAME_TICKS, rows.rows,
               k->registers.count + k->pins.count, frames, all);
    return rows.bad || signatures.bad;
}
