/* One simulated hand holds the object of a running server: a mass that a spring pulls to and fro along x.
 *
 *     ./example TARGET [SECONDS [NAME]]        TARGET: a join link, HOST:PORT, or - to read it from standard input
 *
 * Replace move_hand by your device: read its position, and push the hand with -force_n.
 */
#define _POSIX_C_SOURCE 200809L
#include "cogrip.h"

#include <math.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MASS_KG 0.3
#define SPRING_NPM 200.0
#define DAMPING_NSPM 10.0
#define STROKE_M 0.03

static volatile sig_atomic_t stopped;

static void stop(int number) {
    (void)number;
    stopped = 1;
}

/* Move the hand by a tick under the force that the device gave: semi-implicit Euler. */
static void move_hand(double *position_m, double *velocity_mps, const double *force_n, double time_s, double tick_s) {
    for (int axis = 0; axis < COGRIP_AXES; axis++) {
        const double wanted_m = axis ? 0.0 : STROKE_M * (1.0 - cos(3.14159265358979 * time_s));
        const double hand_n = SPRING_NPM * (wanted_m - position_m[axis]) - DAMPING_NSPM * velocity_mps[axis];
        velocity_mps[axis] += tick_s / MASS_KG * (hand_n - force_n[axis]);
        position_m[axis] += tick_s * velocity_mps[axis];
    }
}

/* Ask for the ticks on time: without the right to it they come when the machine has time. */
static void ask_for_real_time(void) {
    struct sched_param priority;
    priority.sched_priority = 20;
    if (sched_setscheduler(0, SCHED_FIFO, &priority)) fputs("example: no real-time priority; ticks may be late\n", stderr);
}

static void report(const cogrip_client *client) {
    cogrip_status status;
    cogrip_get_status(client, &status, sizeof status);
    printf("{\"ticks\": %lld, \"frames\": %lld, \"lost\": %lld, \"late\": %lld, \"rtt_ms\": %.3f, "
           "\"peak_force_n\": %.3f, \"object_m\": %.6f, "
           "\"down_margin_j\": %.3e, \"device_margin_j\": %.3e",
           (long long)status.tick, (long long)status.down.applied, (long long)status.down.lost, (long long)status.down.late,
               status.rtt_ms,
           status.peak_force_n, status.object_m[0], status.down_margin_j, status.device_margin_j);
    if (!isnan(status.up_margin_j))
        printf(", \"up_margin_j\": %.3e, \"line_margin_j\": %.3e", status.up_margin_j, status.line_margin_j);
    for (int which = 0; which < COGRIP_COUNTS; which++)
        if (cogrip_count(client, which))
            printf(", \"%s\": %llu", cogrip_count_name(which), (unsigned long long)cogrip_count(client, which));
    puts("}");
}

/* Say what has changed since `before`; return the state of now. */
static cogrip_state tell(const cogrip_client *client, cogrip_state before) {
    cogrip_status status;
    cogrip_get_status(client, &status, sizeof status);
    if (status.state == COGRIP_RESUMING && before != COGRIP_RESUMING)
        fputs("example: the server is silent: trying to resume\n", stderr);
    if (status.state == COGRIP_SEATED && before == COGRIP_RESUMING) fputs("example: resumed\n", stderr);
    return status.state;
}

int main(int count, char **arguments) {
    static union {
        long double aligned;
        unsigned char bytes[COGRIP_DRIVER_BYTES];
    } memory;
    const double seconds = count > 2 ? strtod(arguments[2], NULL) : 10.0;
    cogrip_config config = {0};
    cogrip_status status;
    char error[256], target[1300];
    double position_m[COGRIP_AXES] = {0.0}, velocity_mps[COGRIP_AXES] = {0.0}, force_n[COGRIP_AXES] = {0.0};

    if (count < 2 || count > 4 || !(seconds > 0.0)) {
        fputs("usage: example TARGET [SECONDS [NAME]]   TARGET: a join link, HOST:PORT, or - for standard input\n", stderr);
        return 2;
    }
    snprintf(target, sizeof target, "%s", arguments[1]);
    if (!strcmp(target, "-") && !fgets(target, sizeof target, stdin)) target[0] = '\0';
    config.name = count > 3 ? arguments[3] : "";
    config.device = "c:spring";
    config.software = "example";
    config.axes = COGRIP_AXES;
    config.rate_hz = 4096.0;
    config.peak_force_n = 8.0;
    config.speed_mps = 2.0;
    config.apparent_mass_kg = MASS_KG;
    cogrip_driver *driver =
        cogrip_open(memory.bytes, sizeof memory.bytes, target, &config, sizeof config, 0, error, sizeof error);
    if (!driver) {
        fprintf(stderr, "example: %s\n", error);
        return 1;
    }
    cogrip_client *client = cogrip_client_of(driver);
    signal(SIGINT, stop);
    signal(SIGTERM, stop);
    for (cogrip_state state = COGRIP_IDLE; !stopped && state != COGRIP_SEATED
        && state != COGRIP_CLOSED; state = cogrip_run(driver))
        cogrip_sleep_until(cogrip_now_ns() + 2000000);
    cogrip_get_status(client, &status, sizeof status);
    if (status.state != COGRIP_SEATED) {
        fprintf(stderr, "example: %s\n", stopped ? "stopped" : cogrip_reason(client));
        cogrip_close(driver);
        return 1;
    }
    fprintf(stderr, "example: %s holds the object in room %s at %d Hz\n", status.user, status.room, status.device_hz);

    ask_for_real_time();
    const int64_t begun_ns = cogrip_now_ns(), hz = status.device_hz;
    int64_t tick = 0, moved = 0;
    cogrip_state state = status.state;
    while (!cogrip_done(client)) {
        const int64_t due_ns = begun_ns + tick * 1000000000 / hz;
        while (cogrip_sleep_until(due_ns) < due_ns && !stopped) continue;
        for (; moved < tick; moved++)
            move_hand(position_m, velocity_mps, force_n, (double)moved / (double)hz, 1.0 / (double)hz);
        cogrip_tick(driver, tick, position_m, NULL, force_n);
        state = tell(client, state);
        if (stopped || (double)tick >= seconds * (double)hz) cogrip_driver_leave(driver, "its time is over");
        tick = (cogrip_now_ns() - begun_ns) * hz / 1000000000 + 1; /* a tick that was missed is left out */
    }
    report(client);
    const char *why = cogrip_reason(client);
    if (why[0]) fprintf(stderr, "example: %s\n", why);
    cogrip_close(driver);
    return why[0] != '\0';
}
