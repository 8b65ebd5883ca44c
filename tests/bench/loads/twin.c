/* The far end of `dev.py bench peers`: what a server's datagrams cost in C, without session, physics, encryption or recording.

   128 times a second it takes all datagrams that have come with one recvmmsg, adds up the waves of each, and answers each with one of
   the same size, all with one sendmmsg. It prints its port; each line on standard input asks for a reading, whose times are those
   since the one before; the end of standard input ends it. `twin [PROCESSOR]`. */

#define _GNU_SOURCE
#include <arpa/inet.h>
#include <poll.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { MOST = 1024, BYTES = 2048, NETWORK_HZ = 128, MOST_TICKS = 1 << 20, BUFFER_BYTES = 8 << 20, LOOK_TICKS = 3 };

static unsigned char datagrams[MOST][BYTES];
static struct sockaddr_in addresses[MOST];
static struct iovec parts[MOST];
static struct mmsghdr messages[MOST];
static double late_us[MOST_TICKS], work_us[MOST_TICKS];
static double sum; /* of all waves, so that no compiler leaves them out */

static int64_t now_ns(clockid_t clock) {
    struct timespec time;
    clock_gettime(clock, &time);
    return time.tv_sec * INT64_C(1000000000) + time.tv_nsec;
}

static int before(const void *one, const void *other) {
    double a = *(const double *)one, b = *(const double *)other;
    return (a > b) - (a < b);
}

static void print_times(const char *name, double *times, long count) {
    qsort(times, count, sizeof *times, before);
    if (count == 0)
        printf("\"%s\":{}", name);
    else
        printf("\"%s\":{\"p50\":%.3f,\"p99\":%.3f,\"max\":%.3f}", name, times[count / 2], times[count * 99 / 100], times[count - 1]);
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

int main(int count, char **arguments) {
    if (count > 1) {
        cpu_set_t cores;
        CPU_ZERO(&cores);
        CPU_SET(atoi(arguments[1]), &cores);
        if (sched_setaffinity(0, sizeof cores, &cores)) {
            perror("twin: sched_setaffinity");
            return 1;
        }
    }
    int end = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0), bytes = BUFFER_BYTES;
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof here;
    setsockopt(end, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
    setsockopt(end, SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof bytes); /* where it may */
    if (end < 0 || bind(end, (struct sockaddr *)&here, sizeof here) || getsockname(end, (struct sockaddr *)&here, &length)) {
        perror("twin: socket");
        return 1;
    }
    prctl(PR_SET_TIMERSLACK, 1);
    sched_setscheduler(0, SCHED_FIFO, &(struct sched_param){.sched_priority = 1}); /* where it may, as the server does */
    for (int each = 0; each < MOST; each++) {
        parts[each] = (struct iovec){datagrams[each], BYTES};
        messages[each].msg_hdr = (struct msghdr){.msg_name = &addresses[each], .msg_iov = &parts[each], .msg_iovlen = 1};
    }
    printf("{\"port\":%d}\n", ntohs(here.sin_port));
    fflush(stdout);

    const int64_t period_ns = 1000000000 / NETWORK_HZ;
    int64_t due_ns = now_ns(CLOCK_MONOTONIC);
    long ticks = 0, skipped = 0;
    for (long tick = 0;; tick++) {
        due_ns += period_ns;
        struct timespec due = {due_ns / 1000000000, due_ns % 1000000000};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        int64_t begun_ns = now_ns(CLOCK_MONOTONIC);
        while (begun_ns - due_ns >= period_ns) {
            due_ns += period_ns;
            skipped++;
        }
        for (;;) {
            for (int each = 0; each < MOST; each++) {
                parts[each].iov_len = BYTES;
                messages[each].msg_hdr.msg_namelen = sizeof addresses[each];
            }
            int came = recvmmsg(end, messages, MOST, MSG_DONTWAIT, NULL);
            if (came <= 0)
                break;
            for (int each = 0; each < came; each++) {
                sum += values_in(datagrams[each], messages[each].msg_len);
                parts[each].iov_len = messages[each].msg_len;
            }
            for (int sent = 0, some; sent < came; sent += some)
                if ((some = sendmmsg(end, messages + sent, came - sent, 0)) <= 0)
                    some = 1; /* the first of them cannot be sent */
            if (came < MOST)
                break;
        }
        if (ticks < MOST_TICKS) {
            late_us[ticks] = 1e-3 * (begun_ns - due_ns);
            work_us[ticks++] = 1e-3 * (now_ns(CLOCK_MONOTONIC) - begun_ns);
        }
        struct pollfd asked = {STDIN_FILENO, POLLIN, 0};
        if (tick % LOOK_TICKS || poll(&asked, 1, 0) <= 0)
            continue;
        char line[64];
        if (read(STDIN_FILENO, line, sizeof line) <= 0)
            return sum == 0.0; /* nobody has sent a wave */
        printf("{\"time_ns\":%lld,\"cpu_ns\":%lld,\"memory_kb\":%ld,\"ticks\":%ld,\"skipped\":%ld,",
               (long long)now_ns(CLOCK_MONOTONIC), (long long)now_ns(CLOCK_PROCESS_CPUTIME_ID), memory_kb(), ticks, skipped);
        print_times("late_us", late_us, ticks);
        putchar(',');
        print_times("work_us", work_us, ticks);
        puts("}");
        fflush(stdout);
        ticks = 0;
    }
}
