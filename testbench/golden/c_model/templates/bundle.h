/* A golden bundle on disk: its manifest, its block of this model, and its files of hexadecimal words. */
#ifndef GYRO_BUNDLE_H
#define GYRO_BUNDLE_H

#include <stdio.h>

#include "blocks.h"

enum { MOST_PORTS = 1024, SHOWN = 10 };

typedef struct {
    char folder[2048], title[128];
    char *manifest;
    const gyro_block *block;
    int64_t params[MOST_PORTS];
} bundle;

/* 1, or 0 with one line on stderr: no bundle, or of another design than the model */
int bundle_open(bundle *b, const char *folder);
void bundle_close(bundle *b);
int64_t bundle_number(const bundle *b, const char *key);

/* Words of a file, one per line, the first port in the most significant bits */
typedef struct {
    FILE *file;
    int width, digits;
    char *line;
} words;

int words_open(words *w, const bundle *b, const char *name, int width);
int words_read(words *w); /* 1 if there is a word of the right length, -1 at the end, 0 otherwise */
void words_close(words *w);
int64_t words_bits(const words *w, int low, int width, int is_signed);

int width_of(gyro_ports ports);

/* Ports of a word, from the first; returns the place below the last */
int words_ports(const words *w, gyro_ports ports, int top, int64_t *row);

#endif
