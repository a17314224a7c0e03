#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "cc_controller.h"

static cc_controller c;
static double torques[CC_AXES];

int main(int count, char **words)
{
    int repetitions = atoi(words[1]);
    long rows = atol(words[2]);
    cc_readings *r = malloc(rows * sizeof *r);
    double *best = malloc(rows * sizeof *best);
    if (count != 3 || !r || !best || fread(r, sizeof *r, rows, stdin) != (size_t)rows)
        return 2;
    for (long i = 0; i < rows; i++) best[i] = 1e9;
    for (int k = 0; k < repetitions; k++) {
        if (cc_controller_init(&c, cc_controller_parameters)) return 2;
        for (long i = 0; i < rows; i++) {
            struct timespec from, to;
            clock_gettime(CLOCK_MONOTONIC, &from);
            cc_controller_step(&c, &r[i], torques);
            clock_gettime(CLOCK_MONOTONIC, &to);
            double took = 1e9 * (to.tv_sec - from.tv_sec) + (to.tv_nsec - from.tv_nsec);
            if (took < best[i]) best[i] = took;
        }
    }
    fwrite(best, sizeof *best, rows, stdout);
    return 0;
}
