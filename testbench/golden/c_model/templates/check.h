/* Rows of the model against rows of a bundle, with the words of the benches. */
#ifndef GYRO_CHECK_H
#define GYRO_CHECK_H

#include "bundle.h"

typedef struct {
    int64_t rows, bad, first;
} tally;

/* Ports that differ, in the first rows that do; 1 if any does. `mark` is that of the port in RTL: r or o */
int compare(tally *t, const char *place, int64_t n, gyro_ports ports, char mark, const int64_t *want,
            const int64_t *got, const int64_t *mask);

int check_block(const bundle *b);                 /* 0 equal, 1 different, 2 cannot be read */
int check_top(const bundle *b, int64_t frames);

#endif
