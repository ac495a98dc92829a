/* Peak of separate multiplications and additions of doubles on one core: independent chains that stay in registers.
   usage: peak ROUNDS     prints pairs of one multiplication and one addition per CPU second */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#ifdef __AVX512F__
enum { BYTES = 64 };
#define EACH(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5) DO(6) DO(7) DO(8) DO(9) DO(10) DO(11)
#else
#ifdef __AVX__
enum { BYTES = 32 };
#else
enum { BYTES = 16 };
#endif
#define EACH(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5)
#endif
typedef double lane __attribute__((vector_size(BYTES)));
#define ONE(k) +1
enum { CHAINS = EACH(ONE) };

int main(int count, char **argument) {
    volatile double one = 1.0, none = 0.0;
    const lane by = one - (lane){0}, plus = none - (lane){0};
    const long rounds = count > 1 ? atol(argument[1]) : 20000000;
#define START(k) lane m##k = by + k, a##k = by + k;
    EACH(START)
    clock_t began = clock();
    for (long r = 0; r < rounds; r++) {
#define STEP(k) m##k = m##k * by; a##k = a##k + plus;
        EACH(STEP)
    }
    double spent = (double)(clock() - began) / CLOCKS_PER_SEC;
#define SUM(k) + m##k + a##k
    lane sum = EACH(SUM);
    if (sum[0] < 0.0) return 1;
    printf("%.6e\n", (double)BYTES / 8 * CHAINS * rounds / spent);
    return 0;
}
