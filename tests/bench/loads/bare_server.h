/* What servers in C beside benchmarks share: pace, the sum of a datagram's waves, and readings.

   Such a server prints its ports; each line on its standard input asks for a reading, whose times are those since the one before;
   the end of standard input ends it. */

#ifndef BARE_SERVER_H
#define BARE_SERVER_H

#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <poll.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

enum { NETWORK_HZ = 128, MOST_TICKS = 1 << 20, LOOK_TICKS = 3 };

static double late_us[MOST_TICKS], work_us[MOST_TICKS];
static long ticks, skipped;
static int64_t due_ns, begun_ns;

static int64_t now_ns(clockid_t clock) {
    struct timespec time;
    clock_gettime(clock, &time);
    return time.tv_sec * INT64_C(1000000000) + time.tv_nsec;
}

static int before(const void *one, const void *other) {
    double a = *(const double *)one, b = *(const double *)other;
    return (a > b) - (a < b);
}

static void print_times(FILE *out, const char *name, double *times, long count) {
    qsort(times, count, sizeof *times, before);
    if (count == 0)
        fprintf(out, "\"%s\":{}", name);
    else
        fprintf(out, "\"%s\":{\"p50\":%.3f,\"p99\":%.3f,\"max\":%.3f}", name, times[count / 2], times[count * 99 / 100],
                times[count - 1]);
}

/* Add up what stands in a datagram as msgpack's float 64 (0xcb): waves, totals, energies, positions. */
static double values_in(const unsigned char *datagram, unsigned length) {
    double total = 0.0;
    for (unsigned at = 0; at + 9 <= length;) {
        if (datagram[at] != 0xcb) {
            at++;
            continue;
        }
        uint64_t bits = 0;
        double value;
        for (int byte = 1; byte <= 8; byte++)
            bits = bits << 8 | datagram[at + byte];
        memcpy(&value, &bits, sizeof value);
        total += value;
        at += 9;
    }
    return total;
}

static long memory_kb(void) {
    long all = 0, resident = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file) {
        if (fscanf(file, "%ld %ld", &all, &resident) != 2)
            resident = 0;
        fclose(file);
    }
    return resident * (sysconf(_SC_PAGESIZE) / 1024);
}

/* Stay on this processor ("" or NULL any), and run ahead of ordinary processes where it may, as the server does. Return 0, or -1. */
static int engage(const char *processor) {
    if (processor && *processor) {
        cpu_set_t cores;
        CPU_ZERO(&cores);
        CPU_SET(atoi(processor), &cores);
        if (sched_setaffinity(0, sizeof cores, &cores)) {
            perror("sched_setaffinity");
            return -1;
        }
    }
    struct sched_param priority;
    memset(&priority, 0, sizeof priority);
    priority.sched_priority = 1;
    prctl(PR_SET_TIMERSLACK, 1);
    sched_setscheduler(0, SCHED_FIFO, &priority);
    due_ns = now_ns(CLOCK_MONOTONIC);
    return 0;
}

/* Sleep until the next frame begins. */
static void wait_for_frame(void) {
    const int64_t period_ns = 1000000000 / NETWORK_HZ;
    struct timespec due;
    due_ns += period_ns;
    due.tv_sec = due_ns / 1000000000;
    due.tv_nsec = due_ns % 1000000000;
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    begun_ns = now_ns(CLOCK_MONOTONIC);
    while (begun_ns - due_ns >= period_ns) {
        due_ns += period_ns;
        skipped++;
    }
}

/* Count the frame that was done, and give the reading that was asked for. Return -1 once nobody can ask any more. */
static int end_frame(FILE *out) {
    static long frame;
    if (ticks < MOST_TICKS) {
        late_us[ticks] = 1e-3 * (begun_ns - due_ns);
        work_us[ticks++] = 1e-3 * (now_ns(CLOCK_MONOTONIC) - begun_ns);
    }
    struct pollfd asked = {STDIN_FILENO, POLLIN, 0};
    if (frame++ % LOOK_TICKS || poll(&asked, 1, 0) <= 0)
        return 0;
    char line[64];
    if (read(STDIN_FILENO, line, sizeof line) <= 0)
        return -1;
    fprintf(out, "{\"time_ns\":%lld,\"cpu_ns\":%lld,\"memory_kb\":%ld,\"ticks\":%ld,\"skipped\":%ld,",
            (long long)now_ns(CLOCK_MONOTONIC), (long long)now_ns(CLOCK_PROCESS_CPUTIME_ID), memory_kb(), ticks, skipped);
    print_times(out, "late_us", late_us, ticks);
    putc(',', out);
    print_times(out, "work_us", work_us, ticks);
    fputs("}\n", out);
    fflush(out);
    ticks = 0;
    return 0;
}

#endif
