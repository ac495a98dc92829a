#include "bundle.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "json.h"

static char *text_of(const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    long size = fseek(file, 0, SEEK_END) == 0 ? ftell(file) : -1;
    char *text = size >= 0 && size < (1 << 30) ? malloc((size_t)size + 1) : NULL;
    if (text) {
        rewind(file);
        text[fread(text, 1, (size_t)size, file)] = 0;
    }
    fclose(file);
    return text;
}

static int refused(const bundle *b, const char *what, const char *which) {
    fprintf(stderr, "%s: %s%s\n", b->folder, what, which);
    return 0;
}

/* Whether the ports of a manifest, behind `skipped` of them, are those of the block */
static int same_ports(const bundle *b, const char *key, size_t skipped, gyro_ports ports) {
    const char *port = json_first(json_member(b->manifest, key));
    for (; skipped > 0; skipped--) port = json_next(port);
    for (size_t k = 0; k < ports.count; k++, port = json_next(port)) {
        const gyro_port *own = &ports.port[k];
        if (!json_is(json_member(port, "name"), own->name) ||
            json_number(json_member(port, "width"), -1) != own->width)
            return refused(b, "not of this model's design: port ", own->name);
    }
    return port ? refused(b, "not of this model's design: more ports than the block in ", key) : 1;
}

static int same_design(const bundle *b) {
    const char *design = json_member(b->manifest, "design");
    for (size_t k = 0; k < gyro_design_count; k++)
        if (json_number(json_member(design, gyro_design[k].name), gyro_design[k].usual) != gyro_design[k].value)
            return refused(b, "not of this model's design: ", gyro_design[k].name);
    return 1;
}

static int take_params(bundle *b) {
    gyro_ports own = b->block->params;
    char given[MOST_PORTS] = {0}, name[128];
    for (size_t k = 0; k < own.count; k++) b->params[k] = own.port[k].value;
    for (const char *p = json_first(json_member(b->manifest, "params")); p; p = json_next(p)) {
        int place = json_text(json_member(p, "name"), name, sizeof name) ? gyro_place(own, name) : -1;
        if (place < 0) return refused(b, "not of this model's design: parameter ", name);
        b->params[place] = json_number(json_member(p, "raw"), 0);
        given[place] = 1;
    }
    for (size_t k = 0; k < own.count; k++)
        if (!given[k] && !own.port[k].may_be_left_out) return refused(b, "no parameter ", own.port[k].name);
    return 1;
}

int bundle_open(bundle *b, const char *folder) {
    char path[2200], name[64], named[64];
    memset(b, 0, sizeof *b);
    snprintf(b->folder, sizeof b->folder, "%s", folder);
    snprintf(path, sizeof path, "%s/manifest.json", b->folder);
    b->manifest = text_of(path);
    if (!b->manifest) return refused(b, "no bundle: manifest.json cannot be read", "");
    if (!json_text(json_member(b->manifest, "block"), name, sizeof name) ||
        !json_text(json_member(b->manifest, "case"), named, sizeof named))
        return refused(b, "no bundle: manifest.json has no block or case", "");
    snprintf(b->title, sizeof b->title, "%s/%s", name, named);
    b->block = gyro_block_named(name);
    if (!b->block) return refused(b, "no block of this model: ", name);
    return same_design(b) && same_ports(b, "inputs", 1, b->block->inputs) &&
           same_ports(b, "registers", 0, b->block->registers) && same_ports(b, "outputs", 0, b->block->pins) &&
           take_params(b);
}

void bundle_close(bundle *b) { free(b->manifest); }

int64_t bundle_number(const bundle *b, const char *key) { return json_number(json_member(b->manifest, key), -1); }

int width_of(gyro_ports ports) {
    int sum = 0;
    for (size_t k = 0; k < ports.count; k++) sum += ports.port[k].width;
    return sum;
}

int words_open(words *w, const bundle *b, const char *name, int width) {
    char path[2200];
    snprintf(path, sizeof path, "%s/%s.hex", b->folder, name);
    w->width = width;
    w->digits = (width + 3) / 4;
    w->line = calloc((size_t)w->digits + 3, 1);
    w->file = fopen(path, "r");
    return w->file && w->line ? 1 : refused(b, "cannot read file ", path);
}

void words_close(words *w) {
    if (w->file) fclose(w->file);
    free(w->line);
}

int words_read(words *w) {
    if (!fgets(w->line, w->digits + 3, w->file)) return -1;
    size_t length = strcspn(w->line, "\r\n");
    return length == (size_t)w->digits && strspn(w->line, "0123456789abcdef") == length;
}

static unsigned digit(char letter) { return (unsigned)(letter <= '9' ? letter - '0' : letter - 'a' + 10); }

int64_t words_bits(const words *w, int low, int width, int is_signed) {
    uint64_t value = 0;
    for (int k = low / 4; 4 * k < low + width; k++) {
        uint64_t nibble = digit(w->line[w->digits - 1 - k]);
        int up = 4 * k - low;
        value |= up >= 0 ? nibble << up : nibble >> -up;
    }
    value &= (UINT64_C(1) << width) - 1;
    int64_t found = (int64_t)value;
    int64_t half = INT64_C(1) << (width - 1);
    return is_signed && found >= half ? found - half - half : found;
}

int words_ports(const words *w, gyro_ports ports, int top, int64_t *row) {
    for (size_t k = 0; k < ports.count; k++) {
        top -= ports.port[k].width;
        row[k] = words_bits(w, top, ports.port[k].width, ports.port[k].is_signed);
    }
    return top;
}
