#include "json.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

static const char *space(const char *p) {
    while (*p == ' ' || *p == '\n' || *p == '\r' || *p == '\t') p++;
    return p;
}

static const char *behind_text(const char *p) {
    for (p++; *p && *p != '"'; p++)
        if (*p == '\\' && p[1]) p++;
    return *p ? p + 1 : NULL;
}

/* Behind a value of any kind; brackets are counted */
static const char *behind(const char *p) {
    int depth = 0;
    do {
        p = space(p);
        if (*p == '"') {
            p = behind_text(p);
            if (!p) return NULL;
        } else if (*p == '{' || *p == '[') {
            depth++;
            p++;
        } else if (*p == '}' || *p == ']') {
            depth--;
            p++;
        } else if (*p == ',' || *p == ':') {
            p++;
        } else if (*p) {
            while (*p && !strchr(" \n\r\t,:{}[]\"", *p)) p++;
        } else {
            return NULL;
        }
    } while (depth > 0);
    return p;
}

const char *json_first(const char *array) {
    if (!array || (*array != '[' && *array != '{')) return NULL;
    array = space(array + 1);
    return *array == ']' || *array == '}' || !*array ? NULL : array;
}

const char *json_next(const char *value) {
    value = value ? behind(value) : NULL;
    if (!value) return NULL;
    value = space(value);
    return *value == ',' ? space(value + 1) : NULL;
}

int json_is(const char *value, const char *text) {
    size_t length = strlen(text);
    return value && *value == '"' && strncmp(value + 1, text, length) == 0 && value[1 + length] == '"';
}

const char *json_member(const char *object, const char *key) {
    if (!object) return NULL;
    object = space(object);
    if (*object != '{') return NULL;
    for (const char *name = json_first(object); name;) {
        const char *value = *name == '"' ? behind_text(name) : NULL;
        if (!value) return NULL;
        value = space(value);
        if (*value != ':') return NULL;
        value = space(value + 1);
        if (json_is(name, key)) return value;
        name = json_next(value);
    }
    return NULL;
}

int64_t json_number(const char *value, int64_t otherwise) {
    char *end;
    if (!value || !strchr("-0123456789", *value)) return otherwise;
    long long found = strtoll(value, &end, 10);
    return end == value ? otherwise : (int64_t)found;
}

int json_text(const char *value, char *copy, int size) {
    if (!value || *value != '"') return 0;
    const char *end = strchr(value + 1, '"');
    if (!end || end - value - 1 >= size) return 0;
    memcpy(copy, value + 1, (size_t)(end - value - 1));
    copy[end - value - 1] = 0;
    return 1;
}
