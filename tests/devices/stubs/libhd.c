/* A stand-in for libHD, the OpenHaptics HD library: same functions, no device. Written from what the headers declare and the
 * manual says, for tests of a driver: it moves a mass under the forces it is sent, and writes down whatever is done in a wrong
 * order. Functions stub_* are for the test.
 *
 * Like the real one it has one current device, one stack of errors and one servo thread, and it holds a lock while it calls back.
 * With stub_manual(1) there is no thread: stub_step() is one round of the scheduler, on the thread that calls it.
 */
#define _GNU_SOURCE
#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

typedef unsigned int HHD, HDenum, HDerror;
typedef struct { HDerror errorCode; int internalErrorCode; HHD hHD; } HDErrorInfo;
typedef unsigned int (*callback_t)(void *);

enum { DEVICES = 3, ERRORS = 64, OPERATIONS = 16 };
#define NOBODY 0xFFFFFFFFu

typedef struct {
    const char *name;
    char model[64];
    double peak, continuous, stiffness;
    int ready, enabled, in_frame, style, buttons;
    unsigned int calibration;
    int updates_needed;
    double position[3], velocity[3], pending[3], output[3], hand[3], mass;
    double worst, scale_mm, turn[9];
    int turned;
    long frames, torn;
    unsigned int error_at_begin, error_at_end, error_for_ever, error_at_set;
    int set_fails;
} device_t;

typedef struct { callback_t call; void *data; unsigned short priority; unsigned long ticket; int used, once; } operation_t;

static device_t devices[DEVICES] = {
    {.name = "Default Device", .model = "Touch"}, {.name = "Left Device", .model = "Touch"}, {.name = "Right Device", .model = "Touch"}};
static HHD current = NOBODY;
static HDErrorInfo errors[ERRORS];
static int error_count;
static operation_t operations[OPERATIONS];
static unsigned long last_ticket;
static int running, manual, ramp, deaf;
static unsigned int init_error;
static HHD steal = NOBODY;
static int stolen, round_at_init;
static long steps;
static pthread_t servo;
static pthread_mutex_t lock;
static pthread_cond_t stepped = PTHREAD_COND_INITIALIZER;
static char journal[8192], wrongs[4096];

__attribute__((constructor)) static void prepare(void) {
    pthread_mutexattr_t kind;
    pthread_mutexattr_init(&kind);
    pthread_mutexattr_settype(&kind, PTHREAD_MUTEX_RECURSIVE);
    pthread_mutex_init(&lock, &kind);
    for (int i = 0; i < DEVICES; i++) {
        device_t *d = &devices[i];
        d->peak = 3.3; d->continuous = 0.88; d->stiffness = 0.5;
        d->calibration = 0x5000; d->style = 4;
    }
}

static void note(char *where, size_t size, const char *format, ...) {
    size_t used = strlen(where);
    va_list list;
    va_start(list, format);
    vsnprintf(where + used, size - used, format, list);
    va_end(list);
}
#define JOURNAL(...) note(journal, sizeof journal, __VA_ARGS__)
#define WRONG(...) note(wrongs, sizeof wrongs, __VA_ARGS__)

static void push(HDerror code, HHD who) {
    if (error_count < ERRORS) errors[error_count++] = (HDErrorInfo){code, -7, who};
}

static device_t *of(HHD handle) { return handle < DEVICES && devices[handle].ready ? &devices[handle] : NULL; }
static void in(void) { pthread_mutex_lock(&lock); }
static void out(void) { pthread_mutex_unlock(&lock); }

static void round_(void);

/* -- devices ------------------------------------------------------------------------------------------------------------ */

HHD hdInitDevice(const char *name) {
    in();
    HHD handle = NOBODY;
    for (HHD i = 0; i < DEVICES; i++)
        if (!strcmp(devices[i].name, name ? name : "Default Device")) handle = i;
    JOURNAL("init %s\n", name ? name : "NULL");
    if (handle == NOBODY || init_error) {
        push(init_error ? init_error : 0x303, current); /* of whichever device is current, as the header has it */
        handle = NOBODY;
        if (round_at_init) round_(); /* the servo takes that error before whoever called us can */
    } else if (devices[handle].ready) {
        push(0x301, handle);
    } else {
        device_t *d = &devices[handle];
        d->ready = 1; d->enabled = d->in_frame = 0;
        memset(d->pending, 0, sizeof d->pending); memset(d->output, 0, sizeof d->output);
        current = handle;
        if (round_at_init) round_();
    }
    out();
    return handle;
}

void hdDisableDevice(HHD handle) {
    in();
    device_t *d = of(handle);
    if (!d) { push(0x104, handle); out(); return; }
    JOURNAL("disable device %s\n", d->name);
    if (d->output[0] != 0.0 || d->output[1] != 0.0 || d->output[2] != 0.0) WRONG("%s let go with a force\n", d->name);
    if (d->in_frame) WRONG("%s let go within a frame\n", d->name);
    d->ready = d->enabled = 0;
    out();
}

void hdMakeCurrentDevice(HHD handle) {
    in();
    stolen = 0;
    if (of(handle)) current = handle;
    else push(0x104, handle);
    out();
}

HHD hdGetCurrentDevice(void) { in(); HHD handle = current; out(); return handle; }

void hdBeginFrame(HHD handle) {
    in();
    device_t *d = of(handle);
    if (!d) { push(0x104, handle); out(); return; }
    if (d->in_frame) { push(0x400, handle); WRONG("%s: frame begun twice\n", d->name); }
    d->in_frame = 1;
    if (d->error_at_begin) { push(d->error_at_begin, handle); d->error_at_begin = 0; }
    if (d->error_for_ever) push(d->error_for_ever, handle);
    if (ramp) for (int i = 0; i < 3; i++) d->position[i] = (double)(d->frames + 1);
    current = handle;
    stolen = steal != NOBODY;
    if (stolen) { current = steal; steal = NOBODY; }
    out();
}

void hdEndFrame(HHD handle) {
    in();
    device_t *d = of(handle);
    if (!d) { push(0x104, handle); out(); return; }
    if (!d->in_frame) { push(0x401, handle); WRONG("%s: frame ended that was not begun\n", d->name); }
    d->in_frame = 0;
    d->frames++;
    double size = 0.0;
    for (int i = 0; i < 3; i++) {
        d->output[i] = d->enabled ? d->pending[i] : 0.0;
        size += d->output[i] * d->output[i];
        if (d->mass > 0.0) {
            d->velocity[i] += 0.001 * (d->hand[i] + d->output[i]) / d->mass;
            d->position[i] += d->velocity[i]; /* mm a millisecond is m/s */
        }
    }
    if (!(sqrt(size) <= d->worst)) d->worst = sqrt(size);
    if (d->output[0] != d->output[1] || d->output[1] != d->output[2]) d->torn++;
    if (d->error_at_end) { push(d->error_at_end, handle); d->error_at_end = 0; }
    out();
}

void hdEnable(HDenum what) {
    in();
    device_t *d = of(current);
    if (what != 0x4000 || !d) push(0x100, current);
    else {
        JOURNAL("enable %s\n", d->name);
        if (d->calibration != 0x5000) WRONG("%s: forces enabled before it is calibrated\n", d->name);
        d->enabled = 1;
    }
    out();
}

void hdDisable(HDenum what) {
    in();
    device_t *d = of(current);
    if (what != 0x4000 || !d) push(0x100, current);
    else { JOURNAL("disable %s\n", d->name); d->enabled = 0; }
    out();
}

void hdGetDoublev(HDenum what, double *value) {
    in();
    device_t *d = of(current);
    if (!d) push(0x104, current);
    else switch (what) {
        case 0x2050:
            if (!d->in_frame && !stolen) WRONG("%s: position read outside of a frame\n", d->name);
            memcpy(value, d->position, sizeof d->position);
            break;
        case 0x2052: /* column by column, mm */
            for (int i = 0; i < 16; i++) value[i] = i == 15;
            for (int i = 0; i < 9; i++) value[4 * (i / 3) + i % 3] = d->turned ? d->turn[i] : i % 4 == 0;
            memcpy(value + 12, d->position, sizeof d->position);
            break;
        case 0x2602: *value = d->stiffness; break;
        case 0x2603: *value = d->peak; break;
        case 0x2604: *value = d->continuous; break;
        default: push(0x100, current);
    }
    out();
}

void hdSetDoublev(HDenum what, const double *value) {
    in();
    device_t *d = of(current);
    if (what != 0x2700 || !d) push(0x100, current);
    else {
        if (!d->in_frame) WRONG("%s: force set outside of a frame\n", d->name);
        if (!d->enabled && (value[0] != 0.0 || value[1] != 0.0 || value[2] != 0.0)) WRONG("%s: force before it is enabled\n", d->name);
        if (d->set_fails) { d->set_fails--; push(d->error_at_set, current); } /* and the force before it stays */
        else memcpy(d->pending, value, sizeof d->pending);
    }
    out();
}

unsigned char hdIsEnabled(HDenum what) {
    in();
    device_t *d = of(current);
    if (what != 0x4000 || !d) push(0x100, current);
    int on = d && d->enabled;
    out();
    return on;
}

void hdGetIntegerv(HDenum what, int *value) {
    in();
    device_t *d = of(current);
    if (!d) push(0x104, current);
    else if (what == 0x2000) *value = d->buttons;
    else if (what == 0x2555) *value = d->style;
    else push(0x100, current);
    out();
}

const char *hdGetString(HDenum what) {
    in();
    device_t *d = of(current);
    const char *text = d && what == 0x2501 ? d->model : NULL;
    if (!text) push(0x100, current);
    out();
    return text;
}

HDErrorInfo hdGetError(void) {
    in();
    HDErrorInfo error = error_count ? errors[--error_count] : (HDErrorInfo){0, 0, NOBODY};
    out();
    return error;
}

const char *hdGetErrorString(HDerror code) {
    return code == 0x302 ? "Communication error between host and haptic device" : code == 0x303 ? "No such device configuration"
         : code == 0x301 ? "Device already initiated" : "Some other error";
}

HDenum hdCheckCalibration(void) {
    in();
    device_t *d = of(current);
    HDenum state = d ? d->calibration : 0;
    if (!d) push(0x104, current);
    else {
        JOURNAL("check calibration %s\n", d->name);
        if (!d->in_frame) WRONG("%s: calibration checked outside of a frame\n", d->name);
    }
    out();
    return state;
}

void hdUpdateCalibration(HDenum style) {
    in();
    device_t *d = of(current);
    if (!d) push(0x104, current);
    else {
        JOURNAL("update calibration %s %u\n", d->name, style);
        if (!(d->style & (int)style)) push(0x101, current);
        else if (d->updates_needed && !--d->updates_needed) d->calibration = 0x5000;
    }
    out();
}

/* -- scheduler ------------------------------------------------------------------------------------------------------------ */

static void round_(void) {
    in();
    for (int priority = 0xFFFF; priority >= 0; ) {
        int next = -1;
        for (int i = 0; i < OPERATIONS; i++) {
            operation_t *o = &operations[i];
            if (!o->used || o->priority != priority) {
                if (o->used && o->priority < priority && o->priority > next) next = o->priority;
                continue;
            }
            if (o->call(o->data) == 0) o->used = 0;
        }
        priority = next;
    }
    steps++;
    pthread_cond_broadcast(&stepped);
    out();
}

static void *serve(void *unused) {
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (;;) {
        due.tv_nsec += 1000000;
        if (due.tv_nsec >= 1000000000) { due.tv_nsec -= 1000000000; due.tv_sec++; }
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        in();
        int go = running;
        out();
        if (!go) return unused;
        round_();
    }
}

void hdStartScheduler(void) {
    in();
    JOURNAL("start\n");
    if (running) WRONG("scheduler started twice\n");
    int begin = !running && !manual;
    running = 1;
    out();
    if (begin) pthread_create(&servo, NULL, serve, NULL);
}

void hdStopScheduler(void) {
    in();
    JOURNAL("stop\n");
    if (!running) WRONG("scheduler stopped that does not run\n");
    for (int i = 0; i < DEVICES; i++)
        for (int k = 0; k < 3; k++)
            if (devices[i].ready && devices[i].output[k] != 0.0) WRONG("%s: scheduler stopped with a force\n", devices[i].name);
    int join = running && !manual;
    running = 0;
    out();
    if (join) pthread_join(servo, NULL);
}

static operation_t *place(callback_t call, void *data, unsigned short priority) {
    for (int i = 0; i < OPERATIONS; i++)
        if (!operations[i].used) {
            operations[i] = (operation_t){call, data, priority, ++last_ticket + 0x100000000UL, 1, 0};
            return &operations[i];
        }
    push(0x501, current);
    return NULL;
}

unsigned long hdScheduleAsynchronous(callback_t call, void *data, unsigned short priority) {
    in();
    operation_t *o = place(call, data, priority);
    JOURNAL("schedule %u\n", priority);
    unsigned long ticket = o ? o->ticket : 0;
    out();
    return ticket;
}

void hdScheduleSynchronous(callback_t call, void *data, unsigned short priority) {
    in();
    if (deaf) {
        push(0x501, current);
    } else if (manual || !running || pthread_equal(pthread_self(), servo)) {
        call(data);
    } else {
        operation_t *o = place(call, data, priority);
        unsigned long ticket = o ? o->ticket : 0;
        while (o && o->used && o->ticket == ticket) pthread_cond_wait(&stepped, &lock);
    }
    out();
}

unsigned char hdWaitForCompletion(unsigned long ticket, unsigned int how) {
    in();
    unsigned char still = 0;
    for (int i = 0; i < OPERATIONS; i++)
        if (operations[i].used && operations[i].ticket == ticket) still = 1;
    if (how != 0) WRONG("waited for a callback without end\n");
    out();
    return still;
}

void hdUnschedule(unsigned long ticket) {
    in();
    JOURNAL("unschedule\n");
    int found = 0;
    for (int i = 0; i < OPERATIONS; i++)
        if (operations[i].used && operations[i].ticket == ticket) { operations[i].used = 0; found = 1; }
    if (!found) push(0x101, current);
    out();
}

/* -- for the test ----------------------------------------------------------------------------------------------------------- */

void stub_manual(int yes) { manual = yes; }
void stub_step(void) { round_(); }
void stub_wait(long count) {
    in();
    long until = steps + count;
    while (steps < until && running) pthread_cond_wait(&stepped, &lock);
    out();
}
int stub_running(void) { return running; }
int stub_scheduled(void) {
    in();
    int count = 0;
    for (int i = 0; i < OPERATIONS; i++) count += operations[i].used;
    out();
    return count;
}
void stub_model(int i, const char *model, double peak, double continuous, double stiffness) {
    snprintf(devices[i].model, sizeof devices[i].model, "%s", model);
    devices[i].peak = peak; devices[i].continuous = continuous; devices[i].stiffness = stiffness;
}
void stub_calibration(int i, unsigned int state, int style, int updates_needed) {
    devices[i].calibration = state; devices[i].style = style; devices[i].updates_needed = updates_needed;
}
void stub_position(int i, double x, double y, double z) {
    in(); devices[i].position[0] = x; devices[i].position[1] = y; devices[i].position[2] = z; out();
}
void stub_turn(int i, const double *columns) { in(); memcpy(devices[i].turn, columns, sizeof devices[i].turn); devices[i].turned = 1; out(); }
void stub_mass(int i, double kg) { devices[i].mass = kg; }
void stub_hand(int i, double x, double y, double z) { devices[i].hand[0] = x; devices[i].hand[1] = y; devices[i].hand[2] = z; }
void stub_buttons(int i, int mask) { devices[i].buttons = mask; }
void stub_force(int i, double *force) { in(); memcpy(force, devices[i].output, 3 * sizeof(double)); out(); }
double stub_worst(int i) { return devices[i].worst; }
long stub_frames(int i) { in(); long frames = devices[i].frames; out(); return frames; }
long stub_torn(int i) { return devices[i].torn; }
void stub_ramp(int yes) { ramp = yes; }
void stub_error_at_begin(int i, unsigned int code) { devices[i].error_at_begin = code; }
void stub_error_at_end(int i, unsigned int code) { devices[i].error_at_end = code; }
void stub_error_for_ever(int i, unsigned int code) { devices[i].error_for_ever = code; }
void stub_error_at_set(int i, unsigned int code, int times) { devices[i].error_at_set = code; devices[i].set_fails = times; }
void stub_off(int i) { devices[i].enabled = 0; }
void stub_error_of_nobody(unsigned int code) { in(); push(code, NOBODY); out(); }
void stub_init_error(unsigned int code) { init_error = code; }
void stub_steal_current(unsigned int handle) { steal = handle; }
void stub_round_at_init(int yes) { round_at_init = yes; }
void stub_deaf(int yes) { deaf = yes; }
const char *stub_journal(void) { return journal; }
const char *stub_wrongs(void) { return wrongs; }
