/* Counts calls of malloc and its like while a tick runs: linked with -Wl,--wrap=cogrip_tick, in front of the C library's own.
 * */
#include "cogrip.h"

#include <stdio.h>
#include <stdlib.h>

extern void *__libc_malloc(size_t bytes);
extern void *__libc_calloc(size_t count, size_t bytes);
extern void *__libc_realloc(void *memory, size_t bytes);
void __real_cogrip_tick(cogrip_driver *driver, int64_t tick, const double *position_m, const double *velocity_mps,
    double *force_n);
void __wrap_cogrip_tick(cogrip_driver *driver, int64_t tick, const double *position_m, const double *velocity_mps,
    double *force_n);

static int inside;
static long ticks, counted, outside;

void *malloc(size_t bytes) {
    *(inside ? &counted : &outside) += 1;
    return __libc_malloc(bytes);
}

void *calloc(size_t count, size_t bytes) {
    *(inside ? &counted : &outside) += 1;
    return __libc_calloc(count, bytes);
}

void *realloc(void *memory, size_t bytes) {
    *(inside ? &counted : &outside) += 1;
    return __libc_realloc(memory, bytes);
}

static void report(void) {
    const long found = counted, others = outside;
    fprintf(stderr, "%ld ticks, %ld allocations in ticks, %ld outside\n", ticks, found, others);
}

void __wrap_cogrip_tick(cogrip_driver *driver, int64_t tick, const double *position_m, const double *velocity_mps,
    double *force_n) {
    if (!ticks++) atexit(report);
    inside = 1;
    __real_cogrip_tick(driver, tick, position_m, velocity_mps, force_n);
    inside = 0;
}
