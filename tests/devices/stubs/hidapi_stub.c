/* A HID arm inside the C library hidapi: preloaded, its functions stand before those that the Python package brings along.
 *
 * Lock-step: one input report of 14 bytes (or as many as `report_bytes` says) for each output report. What it does and what goes
 * wrong is set by `stub_set` and read by `stub_get`, by name; `stub_text` sets path, product and serial number.
 * The layout of hid_device_info is that of hidapi.h 0.14 and 0.15.
 */
#define _GNU_SOURCE
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <wchar.h>

struct hid_device_info {
    char *path;
    unsigned short vendor_id, product_id;
    wchar_t *serial_number;
    unsigned short release_number;
    wchar_t *manufacturer_string, *product_string;
    unsigned short usage_page, usage;
    int interface_number;
    struct hid_device_info *next;
    int bus_type;
};

typedef struct hid_device_ {
    int nonblocking;
} hid_device;

enum { LONGEST = 65, KEPT = 64 };

struct number {
    const char *name;
    int value, at_first;
};

static struct number numbers[] = {
    {"vendor", 0, 0x1234},    {"product", 0, 0x0006},
    {"devices", 0, 1},        /* how many are on the bus; they differ in serial number and path */
    {"interfaces", 0, 1},     /* of each; the second is a Teensy's debug output */
    {"tells_usage", 0, 1},    /* as hidraw does, and libusb does not */
    {"report_bytes", 0, 14},
    {"open_fails", 0, 0},
    {"stale", 0, 0},          /* a report with counts 111, 222, 333 waits when it is opened */
    {"stale_bytes", 0, 14},
    {"silent", 0, 0},         /* takes reports, sends none */
    {"extra", 0, 0},          /* so many more input reports at each output report, with counts that go up by one */
    {"write_result", 0, 0},   /* not 0: what hid_write gives instead of writing */
    {"hangs", 0, 0},          /* hid_write does not come back before this is 0 again */
    {"unplugged", 0, 0},      /* reads and writes fail */
    {"a", 0, 0},              {"b", 0, 0},
    {"c", 0, 0},              {"d", 0, 0},
    {"e", 0, 0},              {"f", 0, 0},
    {"info", 0, 0},           {"current_a", 0, 0},
    {"current_b", 0, 0},      {"current_c", 0, 0},
    {"command", 0, 0},        {"reports_written", 0, 0},
    {"length_written", 0, 0}, {"last_wait_ms", 0, -2}, /* of hid_read_timeout */
    {"is_open", 0, 0},        {"closed", 0, 0},
    {"left_in_queue", 0, 0},
};

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed = PTHREAD_COND_INITIALIZER;
static char path[256] = "/dev/hidraw7", opened_path[256];
static wchar_t product[64] = L"HID DEVICE", serial[64] = L"0123456789";
static unsigned char queue[KEPT][LONGEST];
static int lengths[KEPT], first, waiting;
static hid_device the_device;

static int *number(const char *name) {
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        if (!strcmp(numbers[i].name, name))
            return &numbers[i].value;
    abort();
}

#define N(name) (*number(#name))

__attribute__((constructor)) void stub_reset(void) {
    pthread_mutex_lock(&lock);
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        numbers[i].value = numbers[i].at_first;
    strcpy(path, "/dev/hidraw7");
    wcscpy(product, L"HID DEVICE");
    wcscpy(serial, L"0123456789");
    first = waiting = 0;
    pthread_mutex_unlock(&lock);
}

void stub_set(const char *name, int value) {
    pthread_mutex_lock(&lock);
    *number(name) = value;
    pthread_cond_broadcast(&changed);
    pthread_mutex_unlock(&lock);
}

int stub_get(const char *name) {
    pthread_mutex_lock(&lock);
    N(left_in_queue) = waiting;
    int value = *number(name);
    pthread_mutex_unlock(&lock);
    return value;
}

void stub_text(const char *name, const char *text) {
    if (!strcmp(name, "path"))
        strncpy(path, text, sizeof path - 1);
    else
        mbstowcs(strcmp(name, "serial") ? product : serial, text, 63);
}

const char *stub_opened(void) { return opened_path; }

static void put16(unsigned char *at, int value) {
    at[0] = (unsigned)value & 0xff;
    at[1] = ((unsigned)value >> 8) & 0xff;
}

static int get16(const unsigned char *at) { return (int16_t)(at[0] | at[1] << 8); }

static void send_report(int a, int b, int c, int length) {
    if (waiting == KEPT)
        return;
    unsigned char *report = queue[(first + waiting) % KEPT];
    int fields[] = {a, b, c, N(d), N(e), N(f), N(info)};
    memset(report, 0, LONGEST);
    for (int i = 0; i < 7; i++)
        put16(report + 2 * i, fields[i]);
    lengths[(first + waiting++) % KEPT] = length;
    pthread_cond_broadcast(&changed);
}

static void act(const unsigned char *data) {
    int field[7];
    for (int i = 0; i < 7; i++)
        field[i] = get16(data + 2 * i);
    N(command) = field[3];
    if (field[3] == 1) {
        N(a) = field[4], N(b) = field[5], N(c) = field[6];
        N(d) = field[0], N(e) = field[1], N(f) = field[2];
        N(info) = field[0] = field[1] = field[2] = 0;
    }
    N(current_a) = field[0], N(current_b) = field[1], N(current_c) = field[2];
}

int hid_init(void) { return 0; }
int hid_exit(void) { return 0; }
const char *hid_version_str(void) { return "0.15.0"; }
const wchar_t *hid_error(hid_device *device) { (void)device; return L"stub"; }
const wchar_t *hid_read_error(hid_device *device) { (void)device; return L"stub"; }

static struct hid_device_info *one(int device, int interface, struct hid_device_info *next) {
    struct hid_device_info *info = calloc(1, sizeof *info);
    char own[300];
    strcpy(own, path);
    if (device)
        strcat(own, "-second");
    if (interface)
        strcat(own, "-debug");
    info->path = strdup(own);
    info->vendor_id = N(vendor), info->product_id = N(product);
    info->serial_number = wcsdup(device ? L"second" : serial);
    info->manufacturer_string = wcsdup(L"stub"), info->product_string = wcsdup(product);
    if (N(tells_usage))
        info->usage_page = interface ? 0xFFC9 : 0xFFAB, info->usage = interface ? 0x0004 : 0x0200;
    info->interface_number = interface, info->next = next, info->bus_type = 1;
    return info;
}

struct hid_device_info *hid_enumerate(unsigned short vendor, unsigned short product_id) {
    struct hid_device_info *list = NULL;
    if (vendor != N(vendor) || product_id != N(product))
        return NULL;
    for (int device = N(devices) - 1; device >= 0; device--)
        for (int interface = N(interfaces) - 1; interface >= 0; interface--)
            list = one(device, interface, list);
    return list;
}

void hid_free_enumeration(struct hid_device_info *info) {
    while (info) {
        struct hid_device_info *next = info->next;
        free(info->path), free(info->serial_number), free(info->manufacturer_string), free(info->product_string), free(info);
        info = next;
    }
}

hid_device *hid_open_path(const char *asked) {
    if (N(open_fails) || strncmp(asked, path, strlen(path)))
        return NULL;
    pthread_mutex_lock(&lock);
    strncpy(opened_path, asked, sizeof opened_path - 1);
    N(is_open) = 1;
    first = waiting = the_device.nonblocking = 0;
    if (N(stale))
        send_report(111, 222, 333, N(stale_bytes));
    pthread_mutex_unlock(&lock);
    return &the_device;
}

hid_device *hid_open(unsigned short vendor, unsigned short product_id, const wchar_t *asked) {
    (void)vendor, (void)product_id, (void)asked;
    return hid_open_path(path);
}

void hid_close(hid_device *device) {
    (void)device;
    pthread_mutex_lock(&lock);
    N(is_open) = 0;
    N(closed)++;
    pthread_mutex_unlock(&lock);
}

int hid_set_nonblocking(hid_device *device, int on) {
    device->nonblocking = on;
    return 0;
}

int hid_write(hid_device *device, const unsigned char *data, size_t length) {
    (void)device;
    pthread_mutex_lock(&lock);
    N(reports_written)++;
    while (N(hangs))
        pthread_cond_wait(&changed, &lock);
    int result = N(unplugged) ? -1 : N(write_result);
    if (!result) {
        N(length_written) = (int)length;
        result = length == (size_t)N(report_bytes) + 1 && !data[0] ? (int)length : -1;
        if (result > 0) {
            act(data + 1);
            for (int i = 0; !N(silent) && i <= N(extra); i++)
                send_report(N(a) + i, N(b), N(c), N(report_bytes));
        }
    }
    pthread_mutex_unlock(&lock);
    return result;
}

/* wait_ms < 0: for ever */
static int take(unsigned char *data, size_t room, int wait_ms) {
    struct timespec end;
    clock_gettime(CLOCK_REALTIME, &end);
    end.tv_nsec += wait_ms % 1000 * 1000000L;
    end.tv_sec += wait_ms / 1000 + end.tv_nsec / 1000000000L;
    end.tv_nsec %= 1000000000L;
    pthread_mutex_lock(&lock);
    while (!waiting && !N(unplugged) && wait_ms)
        if (wait_ms < 0)
            pthread_cond_wait(&changed, &lock);
        else if (pthread_cond_timedwait(&changed, &lock, &end))
            break;
    int length = N(unplugged) ? -1 : 0;
    if (!length && waiting) {
        length = lengths[first] < (int)room ? lengths[first] : (int)room;
        memcpy(data, queue[first], length);
        first = (first + 1) % KEPT;
        waiting--;
    }
    pthread_mutex_unlock(&lock);
    return length;
}

int hid_read_timeout(hid_device *device, unsigned char *data, size_t length, int milliseconds) {
    (void)device;
    stub_set("last_wait_ms", milliseconds);
    return take(data, length, milliseconds);
}

int hid_read(hid_device *device, unsigned char *data, size_t length) {
    return take(data, length, device->nonblocking ? 0 : -1);
}
