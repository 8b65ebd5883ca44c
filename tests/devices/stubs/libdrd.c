/* A stand-in for libdrd, the Force Dimension SDK: the functions that a driver uses, and (from fillers.h, made by the test) all the
 * others that forcedimension_core looks up when it is imported. Functions stub_* are for the test.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { DEVICES = 2 };
enum { POWER = 0, RESET = 3, FORCE = 5, TORQUE = 7, ERROR = 9, OFF_CAUSE = 14 };
enum { BY_WATCHDOG = 3 };
#define WATCHDOG_US 125

typedef struct {
    int open, type, watchdog, guarded, saturated, passive, left, gripping, status[32];
    unsigned int buttons;
    double turn[9], gap;
    double position[3], velocity[3], force[3], hand[3], limit, mass, worst;
    double torque[3], grip, torque_limit, grip_limit;
    long fed_us;
} device_t;

static const device_t at_first[DEVICES] = {
    {.type = 33, .turn = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .limit = -1.0, .status = {[POWER] = 1}}, {.type = 60, .limit = -1.0, .status = {[POWER] = 1}}};
static device_t devices[DEVICES];
static int major, minor, expert;
static long now_us; /* of everybody: a position takes a millisecond, and stub_wait the rest */
static char failing[32];
static char journal[4096], wrongs[2048];

#define JOURNAL(...) snprintf(journal + strlen(journal), sizeof journal - strlen(journal), __VA_ARGS__)
#define WRONG(...) snprintf(wrongs + strlen(wrongs), sizeof wrongs - strlen(wrongs), __VA_ARGS__)

static device_t *of(const char *verb, char id) {
    if (!strcmp(failing, verb)) return NULL;
    return id >= 0 && id < DEVICES && devices[(int)id].open ? &devices[(int)id] : NULL;
}

static void off(device_t *d, int cause) {
    if (d->status[FORCE]) d->status[OFF_CAUSE] = cause;
    d->status[FORCE] = d->status[TORQUE] = d->gripping = 0;
    d->force[0] = d->force[1] = d->force[2] = d->torque[0] = d->torque[1] = d->torque[2] = d->grip = 0.0;
}

/* The firmware: forces go off where none has come for the watchdog's time, and stay off until they are enabled again. */
static void pass(long us) {
    now_us += us;
    for (int i = 0; i < DEVICES; i++)
        if (devices[i].status[FORCE] && devices[i].watchdog && now_us - devices[i].fed_us > WATCHDOG_US * devices[i].watchdog)
            off(&devices[i], BY_WATCHDOG);
}

void dhdGetSDKVersion(int *a, int *b, int *c, int *d) { *a = major; *b = minor; *c = 0; *d = 0; }
const char *dhdErrorGetLastStr(void) { return "no device found"; }

int dhdOpenID(char id) {
    JOURNAL("open %d\n", id);
    if (!strcmp(failing, "open") || id < 0 || id >= DEVICES) return -1;
    devices[(int)id].open = 1;
    return id;
}

int dhdClose(char id) {
    device_t *d = of("close", id);
    JOURNAL("close %d\n", id);
    if (!d) return -1;
    if (d->torque[0] != 0.0 || d->torque[1] != 0.0 || d->torque[2] != 0.0 || d->grip != 0.0) WRONG("%d closed with a torque or a grip\n", id);
    if (d->force[0] != 0.0 || d->force[1] != 0.0 || d->force[2] != 0.0) WRONG("%d closed with a force\n", id);
    d->open = 0;
    return 0;
}

int dhdStop(char id) {
    device_t *d = of("stop", id);
    JOURNAL("stop %d\n", id);
    if (!d) return -1;
    off(d, 4);
    return 0;
}

int dhdEnableForce(unsigned char on, char id) {
    device_t *d = of("enable", id);
    JOURNAL("enable %d %d\n", on, id);
    if (!d) return -1;
    if (d->limit <= 0.0) WRONG("%d: forces enabled without a limit\n", id);
    if (d->status[RESET]) WRONG("%d: forces enabled before it is calibrated\n", id);
    if (on && d->status[POWER]) { d->status[FORCE] = d->status[TORQUE] = 1; d->status[OFF_CAUSE] = 0; }
    if (!on) off(d, 4);
    return 0;
}

int dhdSetMaxForce(double limit, char id) {
    device_t *d = of("limit", id);
    JOURNAL("limit %g %d\n", limit, id);
    if (!d) return -1;
    d->limit = limit;
    return 0;
}

int dhdSetForce(double x, double y, double z, char id) {
    device_t *d = of("force", id);
    if (!d) return -1;
    double size = sqrt(x * x + y * y + z * z);
    if (!(size <= d->limit * (1.0 + 1e-12)) && size != 0.0) WRONG("%d: force of %g N above the limit of %g N\n", id, size, d->limit);
    d->fed_us = now_us;
    if (!d->status[FORCE]) return 0; /* without a word */
    d->force[0] = x; d->force[1] = y; d->force[2] = z;
    if (!(size <= d->worst)) d->worst = size;
    return d->saturated ? 2 : 0;
}

/* A wrist or a gripper has motors where the type says so: delta.6, sigma.6+, sigma.7, lambda.7; omega.7, sigma.7, lambda.7. */
static int kind_in(const device_t *d, const int *kinds, int count) {
    for (int i = 0; d && i < count; i++) if (d->type == kinds[i]) return !d->passive;
    return 0;
}
unsigned char dhdHasActiveWrist(char id) {
    static const int kinds[] = {64, 106, 107, 104, 105, 108, 109};
    return kind_in(of("wrist", id), kinds, 7);
}
unsigned char dhdHasActiveGripper(char id) {
    static const int kinds[] = {35, 37, 104, 105, 108, 109};
    return kind_in(of("gripper", id), kinds, 6);
}
unsigned char dhdIsLeftHanded(char id) {
    device_t *d = of("left", id);
    return d ? d->left : 0;
}

int dhdSetMaxTorque(double limit, char id) {
    device_t *d = of("torque limit", id);
    JOURNAL("torque limit %g %d\n", limit, id);
    if (!d) return -1;
    d->torque_limit = limit;
    return 0;
}

int dhdSetMaxGripperForce(double limit, char id) {
    device_t *d = of("grip limit", id);
    JOURNAL("grip limit %g %d\n", limit, id);
    if (!d) return -1;
    d->grip_limit = limit;
    return 0;
}

int dhdEnableGripperForce(unsigned char on, char id) {
    device_t *d = of("enable grip", id);
    JOURNAL("enable grip %d %d\n", on, id);
    if (!d) return -1;
    d->gripping = on && d->status[FORCE];
    return 0;
}

int dhdSetForceAndTorque(double x, double y, double z, double a, double b, double c, char id) {
    device_t *d = of("torque", id);
    if (!d) return -1;
    double size = sqrt(a * a + b * b + c * c);
    if (!(size <= d->torque_limit * (1.0 + 1e-12)) && size != 0.0) WRONG("%d: torque of %g N m above the limit of %g N m\n", id, size, d->torque_limit);
    int answer = dhdSetForce(x, y, z, id);
    if (d->status[FORCE] && d->status[TORQUE]) { d->torque[0] = a; d->torque[1] = b; d->torque[2] = c; }
    return answer;
}

int dhdSetForceAndGripperForce(double x, double y, double z, double grip, char id) {
    device_t *d = of("grip", id);
    if (!d) return -1;
    if (!(fabs(grip) <= d->grip_limit)) WRONG("%d: gripper's force of %g N above the limit of %g N\n", id, grip, d->grip_limit);
    int answer = dhdSetForce(x, y, z, id);
    if (d->status[FORCE] && d->gripping) d->grip = grip;
    return answer;
}

int dhdGetPosition(double *x, double *y, double *z, char id) {
    device_t *d = of("position", id);
    if (!d) return -1;
    pass(1000);
    for (int i = 0; i < 3 && d->mass > 0.0; i++) { /* a millisecond has passed */
        d->velocity[i] += 0.001 * (d->hand[i] + d->force[i]) / d->mass;
        d->position[i] += 0.001 * d->velocity[i];
    }
    *x = d->position[0]; *y = d->position[1]; *z = d->position[2];
    return d->guarded ? 1 : 0;
}

int dhdGetLinearVelocity(double *x, double *y, double *z, char id) {
    device_t *d = of("velocity", id);
    if (!d) return -1;
    *x = d->velocity[0]; *y = d->velocity[1]; *z = d->velocity[2];
    return 0;
}

int dhdGetOrientationFrame(double *rows, char id) {
    device_t *d = of("orientation", id);
    if (!d) return -1;
    memcpy(rows, d->turn, sizeof d->turn);
    return d->guarded ? 1 : 0;
}

int dhdGetGripperGap(double *gap, char id) {
    device_t *d = of("gripper", id);
    if (!d) return -1;
    *gap = d->gap;
    return d->guarded ? 1 : 0;
}

unsigned int dhdGetButtonMask(char id) {
    device_t *d = of("buttons", id);
    return d ? d->buttons : 0;
}

int dhdGetStatus(int *status, char id) {
    device_t *d = of("status", id);
    if (!d) return -1;
    memcpy(status, d->status, 17 * sizeof(int));
    return 0;
}

int dhdGetSystemType(char id) {
    device_t *d = of("type", id);
    return d ? d->type : -1;
}

int dhdEnableExpertMode(void) { expert = 1; return 0; }
int dhdDisableExpertMode(void) { expert = 0; return 0; }

int dhdSetWatchdog(unsigned char duration, char id) {
    device_t *d = of("watchdog", id);
    JOURNAL("watchdog %d %d\n", duration, id);
    if (!d || !expert) return -1;
    d->watchdog = duration;
    return 0;
}

__attribute__((constructor)) void stub_reset(void) {
    memcpy(devices, at_first, sizeof devices);
    major = 3, minor = 16, expert = 0;
    now_us = 0;
    failing[0] = journal[0] = wrongs[0] = '\0';
}

void stub_version(int a, int b) { major = a; minor = b; }
void stub_fail(const char *verb) { snprintf(failing, sizeof failing, "%s", verb); }
void stub_type(int i, int type) { devices[i].type = type; }
void stub_status(int i, int which, int value) { devices[i].status[which] = value; }
void stub_wait(int ms) { pass(1000L * ms); }
void stub_off(int i, int cause) { off(&devices[i], cause); } /* as by the button on its base */
void stub_power_off(int i) { off(&devices[i], 0); devices[i].status[POWER] = 0; }
void stub_guarded(int i, int yes) { devices[i].guarded = yes; }
void stub_saturated(int i, int yes) { devices[i].saturated = yes; }
void stub_velocity(int i, double x, double y, double z) {
    devices[i].velocity[0] = x; devices[i].velocity[1] = y; devices[i].velocity[2] = z;
}
void stub_turn(int i, const double *rows) { memcpy(devices[i].turn, rows, sizeof devices[i].turn); }
void stub_gap(int i, double m) { devices[i].gap = m; }
void stub_buttons(int i, unsigned int mask) { devices[i].buttons = mask; }
void stub_mass(int i, double kg) { devices[i].mass = kg; }
void stub_hand(int i, double x, double y, double z) { devices[i].hand[0] = x; devices[i].hand[1] = y; devices[i].hand[2] = z; }
void stub_position(int i, double x, double y, double z) {
    devices[i].position[0] = x; devices[i].position[1] = y; devices[i].position[2] = z;
}
void stub_force(int i, double *force) { memcpy(force, devices[i].force, sizeof devices[i].force); }
void stub_own(int i, double *own) { memcpy(own, devices[i].torque, sizeof devices[i].torque); own[3] = devices[i].grip; }
void stub_passive(int i, int yes) { devices[i].passive = yes; }
void stub_left(int i, int yes) { devices[i].left = yes; }
int stub_expert(void) { return expert; }
const char *stub_journal(void) { return journal; }
const char *stub_wrongs(void) { return wrongs; }

#include "fillers.h"
