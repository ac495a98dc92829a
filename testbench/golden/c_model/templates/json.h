/* Reads a text of JSON in place: just what a manifest needs. A pointer stands before a value; NULL is none. */
#ifndef GYRO_JSON_H
#define GYRO_JSON_H

#include <stdint.h>

const char *json_member(const char *object, const char *key);
const char *json_first(const char *array);
const char *json_next(const char *value);
int json_is(const char *value, const char *text); /* whether it is this text */
int64_t json_number(const char *value, int64_t otherwise);
int json_text(const char *value, char *copy, int size); /* 1 if it is a text that fits */

#endif
