/* The far end of `dev.py bench pauses`: what a processor forgets while it waits, awake, for a while.

   It prints, as one line of JSON, how often reading the clock took longer than 1 us in the seconds asked for, and how much of the time
   that was; then, for each kind of access and each pause, the median time of one access of ACCESSES, made in a row after the pause [ns].
   `pauses SECONDS ROUNDS PAUSE_US...` */

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { ACCESSES = 256, PAGE = 4096, LINE = 64, MOST_ROUNDS = 10000 };
static const int64_t INTERRUPTED_NS = 1000;

static int64_t now_ns(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return time.tv_sec * INT64_C(1000000000) + time.tv_nsec;
}

static char data[(ACCESSES + 1) * PAGE];
static char *first_of_line, *first_of_page;

/* Chain `ACCESSES` places, `step` bytes apart and in a shuffled order: each is read only once the one before it is known. */
static char *chain(char *from, long step) {
    static char *places[ACCESSES];
    for (int at = 0; at < ACCESSES; at++)
        places[at] = from + at * step + (step == PAGE ? at % (PAGE / LINE) * LINE : 0);
    srand(1);
    for (int at = ACCESSES - 1; at > 0; at--) {
        int other = rand() % (at + 1);
        char *place = places[at];
        places[at] = places[other];
        places[other] = place;
    }
    for (int at = 0; at < ACCESSES; at++)
        memcpy(places[at], &places[(at + 1) % ACCESSES], sizeof(char *));
    return places[0];
}

static char *follow(char *place) {
    for (int at = 0; at < ACCESSES; at++)
        memcpy(&place, place, sizeof place);
    return place;
}

/* 256 functions: four digits of base 4 in each name. */
#define FOUR(make, name) make(name##0) make(name##1) make(name##2) make(name##3)
#define SIXTEEN(make, name) FOUR(make, name##0) FOUR(make, name##1) FOUR(make, name##2) FOUR(make, name##3)
#define ALL(make, name) \
    SIXTEEN(make, name##0) SIXTEEN(make, name##1) SIXTEEN(make, name##2) SIXTEEN(make, name##3)
#define EVERY(make, name) ALL(make, name##0) ALL(make, name##1) ALL(make, name##2) ALL(make, name##3)
#define MADE(name) __attribute__((noinline, aligned(64))) static void made##name(void) { __asm__ volatile(""); }
#define CALL(name) made##name();
#define POINTER(name) static void (*volatile to##name)(void) = made##name;
#define CALL_BY_POINTER(name) to##name();
EVERY(MADE, _)
EVERY(POINTER, _)
static void call(void) { EVERY(CALL, _) }
static void call_by_pointer(void) { EVERY(CALL_BY_POINTER, _) }
static void read_lines(void) { first_of_line = follow(first_of_line); }
static void read_pages(void) { first_of_page = follow(first_of_page); }

static int before(const void *one, const void *other) {
    int64_t a = *(const int64_t *)one, b = *(const int64_t *)other;
    return (a > b) - (a < b);
}

static double median_ns(void (*access)(void), int64_t pause_ns, long rounds) {
    static int64_t times[MOST_ROUNDS];
    for (long round = 0; round < rounds; round++) {
        int64_t until = now_ns() + pause_ns, begun;
        do
            begun = now_ns();
        while (begun < until);
        access();
        times[round] = now_ns() - begun;
    }
    qsort(times, rounds, sizeof *times, before);
    return (double)times[rounds / 2] / ACCESSES;
}

int main(int count, char **words) {
    double seconds = count > 2 ? atof(words[1]) : 1.0;
    long rounds = count > 2 ? atol(words[2]) : 100;
    struct {
        const char *name;
        void (*access)(void);
    } kinds[] = {{"line", read_lines}, {"page", read_pages}, {"call", call}, {"pointer", call_by_pointer}};
    if (rounds < 1 || rounds > MOST_ROUNDS)
        return 2;
    memset(data, 1, sizeof data);
    char *aligned = data + (PAGE - (uintptr_t)data % PAGE) % PAGE;
    int64_t begun = now_ns(), last = begun, now, lost = 0, times = 0;
    while ((now = now_ns()) - begun < seconds * 1e9) {
        if (now - last > INTERRUPTED_NS) {
            times++;
            lost += now - last;
        }
        last = now;
    }
    printf("{\"interruptions_per_s\":%.1f,\"lost\":%.6f,\"access_ns\":{", times / seconds, lost / (seconds * 1e9));
    for (unsigned kind = 0; kind < sizeof kinds / sizeof *kinds; kind++) {
        first_of_line = chain(aligned, LINE);
        if (kinds[kind].access == read_pages)
            first_of_page = chain(aligned, PAGE);
        printf("%s\"%s\":[", kind ? "," : "", kinds[kind].name);
        for (int pause = 3; pause < count; pause++)
            printf("%s%.3f", pause > 3 ? "," : "", median_ns(kinds[kind].access, atoll(words[pause]) * 1000, rounds));
        printf("]");
    }
    printf("}}\n");
    return 0;
}
