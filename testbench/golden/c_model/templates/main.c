/* check [--frames N] BUNDLE ...     exit code 0: equal, 1: a bundle differs, 2: one cannot be compared */
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "json.h"

int main(int count, char **argument) {
    static bundle b;
    int64_t frames = 0;
    int worst = 0, done = 0;
    for (int k = 1; k < count; k++) {
        if (strcmp(argument[k], "--frames") == 0 && k + 1 < count) {
            frames = strtoll(argument[++k], NULL, 10);
            continue;
        }
        int found = 2;
        if (bundle_open(&b, argument[k]))
            found = json_member(b.manifest, "frames") ? check_top(&b, frames) : check_block(&b);
        bundle_close(&b);
        worst = found > worst ? found : worst;
        done++;
        fflush(stdout);
    }
    if (!done) fprintf(stderr, "usage: check [--frames N] BUNDLE ...; no bundle was given\n");
    return done ? worst : 2;
}
