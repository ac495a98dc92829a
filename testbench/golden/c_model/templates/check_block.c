#include <inttypes.h>
#include <string.h>

#include "check.h"

static uint64_t bits_of(int64_t value, int width) { return (uint64_t)value & ((UINT64_C(1) << width) - 1); }

int compare(tally *t, const char *place, int64_t n, gyro_ports ports, char mark, const int64_t *want,
            const int64_t *got, const int64_t *mask) {
    int differs = 0;
    for (size_t k = 0; k < ports.count; k++) {
        uint64_t care = mask ? (uint64_t)mask[k] : UINT64_MAX;
        int width = ports.port[k].width;
        if (((uint64_t)want[k] ^ (uint64_t)got[k]) & care) {
            differs = 1;
            if (t->bad < SHOWN)
                printf("%s %" PRId64 ": %c_%s: expected %" PRIx64 ", got %" PRIx64 " (hex) [c]\n", place, n, mark,
                       ports.port[k].name, bits_of(want[k], width), bits_of(got[k], width));
        }
    }
    return differs;
}

static int run(const bundle *b, words *stim, words *exp, words *mask) {
    static int64_t state[MOST_PORTS], next[MOST_PORTS], pins[MOST_PORTS], in[MOST_PORTS];
    static int64_t want_state[MOST_PORTS], want_pins[MOST_PORTS], care_state[MOST_PORTS], care_pins[MOST_PORTS];
    const gyro_block *k = b->block;
    tally t = {0, 0, 0};
    int64_t n = bundle_number(b, "n");
    gyro_reset(k, state);
    for (; t.rows < n; t.rows++) {
        if (words_read(stim) != 1 || words_read(exp) != 1 || words_read(mask) != 1) return -1;
        int rst = (int)words_bits(stim, stim->width - 1, 1, 0);
        words_ports(stim, k->inputs, stim->width - 1, in);
        words_ports(exp, k->pins, words_ports(exp, k->registers, exp->width, want_state), want_pins);
        words_ports(mask, k->pins, words_ports(mask, k->registers, mask->width, care_state), care_pins);
        k->show(b->params, state, in, pins);
        int differs = compare(&t, "row", t.rows, k->registers, 'r', want_state, state, care_state);
        differs |= compare(&t, "row", t.rows, k->pins, 'o', want_pins, pins, care_pins);
        if (differs && t.bad++ == 0) t.first = t.rows;
        k->step(b->params, state, in, next);
        memcpy(state, next, k->registers.count * sizeof state[0]);
        if (rst) gyro_reset(k, state);
    }
    if (words_read(stim) != -1) return -1;
    if (t.bad)
        printf("FAIL %s: %" PRId64 " of %" PRId64 " rows differ, the first is row %" PRId64 " [c]\n", b->title, t.bad,
               t.rows, t.first);
    else
        printf("PASS %s: %" PRId64 " rows, %zu ports [c]\n", b->title, t.rows, k->registers.count + k->pins.count);
    return t.bad != 0;
}

int check_block(const bundle *b) {
    int in_width = 1 + width_of(b->block->inputs), out_width = width_of(b->block->registers) + width_of(b->block->pins);
    words stim = {0}, exp = {0}, mask = {0};
    int found = words_open(&stim, b, "stim", in_width) && words_open(&exp, b, "exp", out_width) &&
                        words_open(&mask, b, "mask", out_width)
                    ? run(b, &stim, &exp, &mask)
                    : 2;
    if (found < 0) fprintf(stderr, "%s: stim, exp and mask.hex do not hold the rows of the manifest\n", b->folder);
    words_close(&stim);
    words_close(&exp);
    words_close(&mask);
    return found < 0 ? 2 : found;
}
