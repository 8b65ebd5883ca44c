/* A client of cogrip for one person's seat: see cogrip.h. Sections in brackets are those of protocol/SPEC.md. */
#ifndef COGRIP_NO_DRIVER
#ifndef _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200809L
#endif
#endif

#include "cogrip.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#ifdef __FAST_MATH__
#error "cogrip.c: build without -ffast-math: the energy ledgers live by what an addition rounds away"
#endif
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF /* gcc: -std=c99 or -ffp-contract=off */
#endif

enum {
    TAG_HELLO = 1, TAG_WELCOME, TAG_REFUSE, TAG_WAVES, TAG_STATE, TAG_HEARTBEAT, TAG_LEAVE, TAG_FAREWELL, TAG_VIEW, TAG_POWER,
    TAG_PERSON, TAG_BODIES, TAG_GEOM, TAG_MARK, TAG_SET_HAND, TAG_EFFECTS, TAG_EDGES, TAG_REDIRECT, TAG_RESTART,
    TAG_NOTE, TAG_PARTNER
};
enum {
    AXES = COGRIP_AXES,
    WIRE_AXES = 6,          /* most axes of any seat */
    GRIP_AXES = 4,          /* of one with a gripper [1] */
    MOST_WAVES = 78,        /* waves of a message */
    MOST_STATE = 18,        /* places, velocities, turning and proxy of a message of waves */
    MOST_FRAMES = 32,       /* frames of a message */
    MOST_TICKS = 20000,     /* of a frame */
    HISTORY = 1024,         /* frames that a receiver remembers */
    FURTHEST_JUMP = 16384,  /* highest number of the newest frame in the first datagram of a line */
    SLOTS = 2 * HISTORY + 2 * MOST_FRAMES,
    RECENT = 256,           /* datagrams in which the same newest frame is a duplicate */
    REALIGN_WINDOW = 128,   /* [5.5] */
    LATE_RUN = 16,
    WINDOW = 1024,          /* [5.6], frames or pops */
    HALF_QUIET = 256,
    SPACING = 16,
    QUIET = 64,
    DEEPEST = 256,
    PHASE_QUIET = 256,      /* [5.7] */
    PHASE_PRESSING = 64,
    MOST_EDGES = 16,        /* [5.9] */
    MOST_AT_ONCE = 2,       /* messages of edges between two frames */
    MOST_AGE = 65535,
    LEAST_DEVICE_HZ = 250,
    HELLO_BYTES = 1024,
    MOST_TOKEN = 640,
    LEAVE_TEXT_BYTES = 150,
    MOST_ABSENT_S = 10,     /* of a loop, after which its session is over */
    MOST_PARTNERS = 7,      /* of a hand [3.23] */
    LATEST_HISTORY = 256,   /* messages of which it is known whether they came, where the newest wins [7] */
    MOST_COPY_TICKS = 64,   /* that a copy of the object makes up for at once */
    KIND_BYTES = 33,        /* of a coupling.kind, with its end */
    OUTBOX = 8              /* messages that wait to be sent */
};
#define MS INT64_C(1000000)
#define HELLO_EVERY_NS (250 * MS)
#define GIVE_UP_NS (3000 * MS)
#define HEARTBEAT_EVERY_NS (250 * MS)
#define STALE_NS (100 * MS)
#define QUIET_NS (500 * MS)
#define LOST_NS (2000 * MS)
#define RESUME_GIVE_UP_NS (10000 * MS)
#define LEAVE_EVERY_NS (100 * MS)
#define LEAVE_GIVE_UP_NS (600 * MS)
#define MOST_RTT_NS (60000 * MS)
#define DRIFT_PART 2000 /* 500 ppm */
#define MOST_INT (INT64_C(1) << 53)
#define NO_BOUND 1e6
#define UNIT 0.001 /* how far the squares of a quaternion may be off 1 */
#define ROUNDOFF 1.1102230246251565e-16 /* 2^-53 */
#define RESERVE_FRACTION (32.0 * ROUNDOFF)
#define BOUND_FRACTION (8.0 * ROUNDOFF)
#define START_S (1.0 / 32.0)

/* Numbers of this client, the same as the reference's (docs/device_port.md, client/cogrip/client/safety/limiter.py). */
#define RAMP_IN_S 0.3
#define RAMP_OUT_S 0.1
#define FAULT_OUT_S 0.015
#define STALL_S 0.02       /* without samples: then the device has stalled */
#define WATCHDOG_S 0.1     /* without a tick: the hand held an old force */
#define AT_LIMIT_S 0.5     /* at the peak force: then it is saturated */
#define MOST_SLOPE_NPS 1000.0
#define SOFT_SLOPE_NPS 410.0 /* in a gap, and until the force has met the law again, SOFT_S at most */
#define SOFT_S 0.05
#define RELEASE_S 0.5      /* in which the line releases the object */
#define OPEN_FRACTION 0.5  /* of a wave, that a released end reflects */
#define MEMORY 0.6         /* of the velocity's estimator, at MEMORY_TICK_S and above */
#define MEMORY_TICK_S (1.0 / 1024.0)
#define RELAX_RAD_S 100.0  /* of the series impedance */
#define LEAST_DEFLECTION_M 1e-9
#define MOST_DEFLECTION_M 0.05
#define FREE_RESERVE_MPS 1.0    /* speed whose kinetic energy is E_free of the device port */
#define FADE_TICKS 3.0          /* at speed limit and peak force: over their energy the force is scaled from 1 to 0 */
#define TOLERATED_FRACTION 0.25 /* of E_free: a deficit up to this is tolerated */
#define INJECTED_FRACTION 0.1   /* of the carried impedance: damping that is injected where all of E_free is used up */
#define WITHHELD_FRACTION (1.0 / 16.0)
#define JUMP 2.0           /* times the speed limit: no hand moves so */
#define JUMP_M 0.001
#define FADE 0.85
#define COMPENSATION_FRACTION (1.0 / 16.0)
#define COMPENSATION_LIMIT 0.02
#define RESERVE_FRAMES 8.0

static double least(double a, double b) { return a < b ? a : b; }
static double most(double a, double b) { return a > b ? a : b; }
static int64_t least_int(int64_t a, int64_t b) { return a < b ? a : b; }
static int64_t most_int(int64_t a, int64_t b) { return a > b ? a : b; }
static double within(double value, double bound) { return most(-bound, least(bound, value)); }

static double size_of(const double *row, int axes) {
    double square = 0.0;
    for (int axis = 0; axis < axes; axis++) square += row[axis] * row[axis];
    return sqrt(square);
}

/* A sum of any number of terms, by Kahan's method [5.2]. */
typedef struct sum {
    double value, error;
} sum;

static void add(sum *total, double term) {
    const double before = total->value;
    term -= total->error;
    total->value = before + term;
    total->error = (total->value - before) - term;
}

/* ---- MessagePack [3.1] ----------------------------------------------------------------------- */

typedef struct reader {
    const unsigned char *at, *end;
    int bad; /* something did not fit: all that is read from here on is 0 */
} reader;

static uint64_t big_endian(const unsigned char *at, size_t bytes) {
    uint64_t value = 0;
    while (bytes--) value = value << 8 | *at++;
    return value;
}

static const unsigned char *take(reader *from, uint64_t bytes) {
    const unsigned char *at = from->at;
    if (from->bad || (uint64_t)(from->end - at) < bytes) {
        from->bad = 1;
        return NULL;
    }
    from->at += bytes;
    return at;
}

static int peek(const reader *from) { return from->bad || from->at == from->end ? -1 : *from->at; }

static uint64_t take_number(reader *from, size_t bytes) {
    const unsigned char *at = take(from, bytes);
    return at ? big_endian(at, bytes) : 0;
}

/* Read a whole number of any format. Returns 1, 0 where the next element is none; *negative: it is *value - 2^64. */
static int take_integer(reader *from, uint64_t *value, int *negative) {
    const int head = peek(from);
    *negative = 0;
    if (head < 0) return 0;
    if (head <= 0x7f || head >= 0xe0) {
        from->at++;
        *negative = head >= 0xe0;
        *value = *negative ? (uint64_t)(int64_t)(head - 256) : (uint64_t)head;
        return 1;
    }
    if (head < 0xcc || head > 0xd3) return 0;
    from->at++;
    const size_t bytes = (size_t)1 << ((head - 0xcc) & 3);
    *value = take_number(from, bytes);
    if (head >= 0xd0 && (*value >> (8 * bytes - 1)) & 1) {
        *negative = 1;
        if (bytes < 8) *value |= ~UINT64_C(0) << (8 * bytes);
    }
    return !from->bad;
}

static int64_t get_int(reader *from, int64_t low, int64_t high) {
    uint64_t value = 0;
    int negative = 0;
    if (!take_integer(from, &value, &negative) || (!negative && value > INT64_MAX)) {
        from->bad = 1;
        return 0;
    }
    const int64_t found = negative ? -(int64_t)(~value) - 1 : (int64_t)value;
    if (found < low || found > high) from->bad = 1;
    return from->bad ? 0 : found;
}

/* A real of any size, nan and infinities included; whole numbers, too. */
static double get_any_real(reader *from) {
    const int head = peek(from);
    uint64_t bits = 0;
    int negative = 0;
    if (head == 0xca) {
        float single;
        from->at++;
        const uint32_t narrow = (uint32_t)take_number(from, 4);
        memcpy(&single, &narrow, sizeof single);
        return from->bad ? 0.0 : (double)single;
    }
    if (head == 0xcb) {
        double value;
        from->at++;
        bits = take_number(from, 8);
        memcpy(&value, &bits, sizeof value);
        return from->bad ? 0.0 : value;
    }
    if (take_integer(from, &bits, &negative)) return negative ? -(double)(~bits) - 1.0 : (double)bits;
    from->bad = 1;
    return 0.0;
}

static double get_real(reader *from, double low, double high) {
    const double value = get_any_real(from);
    if (!(value >= low && value <= high)) from->bad = 1;
    return from->bad ? 0.0 : value;
}

static int get_nil(reader *from) {
    if (peek(from) != 0xc0) return 0;
    from->at++;
    return 1;
}

static double get_account_real(reader *from) { return get_nil(from) ? NAN : get_any_real(from); }

static int get_bool(reader *from) {
    const int head = peek(from);
    if (head != 0xc2 && head != 0xc3) {
        from->bad = 1;
        return 0;
    }
    from->at++;
    return head == 0xc3;
}

/* Length of an array, or with map = 1 of a map. */
static uint64_t get_length(reader *from, int map, uint64_t low, uint64_t high) {
    const int head = peek(from), fixed = map ? 0x80 : 0x90, wide = map ? 0xde : 0xdc;
    uint64_t length = 0;
    if (head >= fixed && head <= fixed + 15) {
        from->at++;
        length = (uint64_t)(head - fixed);
    } else if (head == wide || head == wide + 1) {
        from->at++;
        length = take_number(from, head == wide ? 2 : 4);
    } else {
        from->bad = 1;
    }
    if (length < low || length > high) from->bad = 1;
    return from->bad ? 0 : length;
}

/* Code points of valid UTF-8, -1 where it is not. */
static int64_t code_points(const unsigned char *at, uint64_t bytes) {
    const unsigned char *end = at + bytes;
    int64_t count = 0;
    for (; at < end; count++) {
        const unsigned head = *at++;
        if (head < 0x80) continue;
        const int more = head < 0xc2 || head > 0xf4 ? 0 : head < 0xe0 ? 1 : head < 0xf0 ? 2 : 3;
        if (!more || end - at < more) return -1;
        uint32_t point = head & (0x3fU >> more);
        for (int step = 0; step < more; step++) {
            if ((*at & 0xc0) != 0x80) return -1;
            point = point << 6 | (*at++ & 0x3fU);
        }
        if ((more == 2 && (point < 0x800 || (point >= 0xd800 && point <= 0xdfff)))
            || (more == 3 && (point < 0x10000 || point > 0x10ffff)))
            return -1;
    }
    return count;
}

/* A text of `low` to `high` code points, into `into` of `size` bytes, cut there; NULL: it is only checked. */
static void get_text(reader *from, char *into, size_t size, int64_t low, int64_t high) {
    const int head = peek(from);
    uint64_t bytes = 0;
    if (into) into[0] = '\0';
    if (head >= 0xa0 && head <= 0xbf) {
        from->at++;
        bytes = (uint64_t)(head - 0xa0);
    } else if (head >= 0xd9 && head <= 0xdb) {
        from->at++;
        bytes = take_number(from, (size_t)1 << (head - 0xd9));
    } else {
        from->bad = 1;
    }
    const unsigned char *at = take(from, bytes);
    if (!at) return;
    const int64_t count = code_points(at, bytes);
    if (count < low || count > high) {
        from->bad = 1;
        return;
    }
    if (into) {
        size_t kept = bytes < size ? (size_t)bytes : size - 1;
        while (kept < bytes && kept && (at[kept] & 0xc0) == 0x80) kept--;
        memcpy(into, at, kept);
        into[kept] = '\0';
    }
}

static int is_letter(int c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9'); }

/* A text of letters and digits, and of `others` but at its beginning. */
static void get_name(reader *from, char *into, size_t size, int64_t high, const char *others) {
    get_text(from, into, size, 1, high);
    for (const char *at = into; !from->bad && *at; at++)
        if (!is_letter((unsigned char)*at) && (at == into || !strchr(others, *at))) from->bad = 1;
}

static void get_secret(reader *from, char *into, size_t size) {
    get_text(from, into, size, 0, 32);
    for (const char *at = into; !from->bad && *at; at++)
        if (!is_letter((unsigned char)*at) && *at != '-' && *at != '_') from->bad = 1;
}

/* Place of a text among `count` names; the text is malformed where it is none of them. */
static int get_choice(reader *from, const char *const *names, int count) {
    char text[32];
    get_text(from, text, sizeof text, 0, 31);
    for (int place = 0; place < count && !from->bad; place++)
        if (!strcmp(text, names[place])) return place;
    from->bad = 1;
    return 0;
}

/* Pass over one element and all in it. Its work is bounded by the message: every element has at least a byte. */
static void skip(reader *from) {
    uint64_t left = 1;
    while (left && !from->bad) {
        const int head = peek(from);
        uint64_t bytes = 1, inside = 0;
        left--;
        if (head < 0 || head == 0xc1) {
            from->bad = 1;
        } else if (head <= 0x7f || head >= 0xe0 || head == 0xc0 || head == 0xc2 || head == 0xc3) {
            bytes = 1;
        } else if (head <= 0x9f) {
            inside = (uint64_t)(head & 15) << (head <= 0x8f);
        } else if (head <= 0xbf) {
            bytes += (uint64_t)(head & 31);
        } else if (head >= 0xdc) {
            from->at++;
            inside = take_number(from, head & 1 ? 4 : 2) << (head >= 0xde);
            bytes = 0;
        } else if (head >= 0xca && head <= 0xd3) {
            bytes += head == 0xca ? 4 : head == 0xcb ? 8 : UINT64_C(1) << ((head - 0xcc) & 3);
        } else if (head >= 0xd4 && head <= 0xd8) {
            bytes += 1 + (UINT64_C(1) << (head - 0xd4));
        } else { /* bin 8 to 32, ext 8 to 32, str 8 to 32 */
            const int wide = head >= 0xd9 ? head - 0xd9 : head >= 0xc7 ? head - 0xc7 : head - 0xc4;
            from->at++;
            bytes = take_number(from, (size_t)1 << wide) + (head >= 0xc7 && head <= 0xc9);
        }
        take(from, bytes);
        left += inside;
    }
}

typedef struct writer {
    unsigned char *at, *end;
    int full;
} writer;

static void put_bytes(writer *to, const void *bytes, size_t count) {
    if ((size_t)(to->end - to->at) < count) {
        to->full = 1;
        return;
    }
    memcpy(to->at, bytes, count);
    to->at += count;
}

static void put_head(writer *to, int head, uint64_t value, int bytes) {
    unsigned char out[9];
    out[0] = (unsigned char)head;
    for (int place = bytes; place > 0; place--, value >>= 8) out[place] = (unsigned char)(value & 0xff);
    put_bytes(to, out, (size_t)bytes + 1);
}

/* In the shortest format. */
static void put_int(writer *to, int64_t value) {
    if (value >= 0) {
        if (value < 0x80) put_head(to, (int)value, 0, 0);
        else if (value <= 0xff) put_head(to, 0xcc, (uint64_t)value, 1);
        else if (value <= 0xffff) put_head(to, 0xcd, (uint64_t)value, 2);
        else if (value <= 0xffffffff) put_head(to, 0xce, (uint64_t)value, 4);
        else put_head(to, 0xcf, (uint64_t)value, 8);
    } else if (value >= -32) put_head(to, (int)(value + 256), 0, 0);
    else if (value >= INT8_MIN) put_head(to, 0xd0, (uint64_t)value, 1);
    else if (value >= INT16_MIN) put_head(to, 0xd1, (uint64_t)value, 2);
    else if (value >= INT32_MIN) put_head(to, 0xd2, (uint64_t)value, 4);
    else put_head(to, 0xd3, (uint64_t)value, 8);
}

static void put_real(writer *to, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_head(to, 0xcb, bits, 8);
}

static void put_nil(writer *to) { put_head(to, 0xc0, 0, 0); }
static void put_bool(writer *to, int value) { put_head(to, value ? 0xc3 : 0xc2, 0, 0); }

static void put_known(writer *to, double value) {
    if (isnan(value)) put_nil(to);
    else put_real(to, value);
}

static void put_array(writer *to, int length) {
    if (length < 16) put_head(to, 0x90 | length, 0, 0);
    else put_head(to, 0xdc, (uint64_t)length, 2);
}

static void put_row(writer *to, const double *row, int count) {
    put_array(to, count);
    for (int place = 0; place < count; place++) put_real(to, row[place]);
}

static void put_known_row(writer *to, const double *row, int count) {
    put_array(to, count);
    for (int place = 0; place < count; place++) put_known(to, row[place]);
}

/* A text, cut to `bytes` at the border of a character. */
static void put_text(writer *to, const char *text, size_t bytes) {
    size_t length = strlen(text);
    if (length > bytes) {
        length = bytes;
        while (length && ((unsigned char)text[length] & 0xc0) == 0x80) length--;
    }
    if (length < 32) put_head(to, (int)(0xa0 | length), 0, 0);
    else if (length < 256) put_head(to, 0xd9, length, 1);
    else put_head(to, 0xda, length, 2);
    put_bytes(to, text, length);
}

static void copy_text(char *into, size_t size, const char *text) {
    const size_t length = strlen(text), kept = length < size ? length : size - 1;
    memcpy(into, text, kept);
    into[kept] = '\0';
}

/* ---- Messages [3.3 to 3.10] ------------------------------------------------------------------ */

typedef struct stamp {
    int64_t sent_ns, echo_ns, held_ns;
} stamp;

typedef struct waves {
    int64_t session, first, acknowledged, phase, applied, since, edges;
    int count, totals, squares_count, states; /* lengths of the lists */
    double wave[MOST_WAVES], total[WIRE_AXES], squares[WIRE_AXES], state[MOST_STATE];
    double made_j, port_j, impedance_nspm;
    stamp sent;
} waves;

enum { CONCEAL_ZERO, CONCEAL_REPAID, CONCEAL_TANK, CONCEAL_ELASTIC };
enum { DECIMATE_BOXCAR, DECIMATE_LOWPASS, DECIMATE_NONE };

typedef struct settings {
    char room[161], user[161];
    char kind[KIND_BYTES]; /* of coupling: whether this client has it is asked of its table */
    int seat, device_hz, network_hz, decimator, velocity_encoder, axes, automatic, playout_frames, redundancy,
        concealment, people;
    int grips;      /* its impedance behind the places is that of a gripper [3.4] */
    int scaled;     /* the tool moves in a frame of its own [3.4] */
    int aided;      /* a workspace limit, or a handle that is to be carried [3.4] */
    int scene;      /* the object is one of a scene */
    int emulated;   /* an impairment of the link is to be emulated */
    uint64_t print; /* of all its bytes: a resumed seat has the same */
    double impedance_nspm, lowpass_rad_s, rendered_npm, late, tank_mj, wave_filter_hz;
    double stiffness_npm, damping_nspm, mass_kg, object_nspm; /* spring of the seat; the object */
} settings;

enum { MOST_FRONTS = 8, MOST_REDIRECTS = 4, MOST_WAIT_MS = 600000 };

typedef struct redirect {
    int64_t nonce;
    char places[1 + MOST_FRONTS][4 * 60 + 1]; /* of the room, then of the fronts */
    int count;
} redirect;

typedef struct welcome {
    int64_t nonce, session;
    settings seat;
    char ticket[33];
    int player;
} welcome;

/* Intention of one hand [3.23]. */
typedef struct intent {
    int64_t made_ns;
    int seat, axes, rates; /* axes, rates: lengths of the lists */
    double place_m[WIRE_AXES], rate_mps[WIRE_AXES], stiffness_npm, donated_j;
} intent;

typedef struct told_partners {
    int64_t session, number, acknowledged, edges;
    stamp sent;
    int places, rates, count;
    double position_m[WIRE_AXES], velocity_mps[WIRE_AXES], port_j;
    intent intents[MOST_PARTNERS];
} told_partners;

typedef struct refusal {
    int64_t nonce;
    char code[161], reason[COGRIP_TEXT_BYTES];
} refusal;

typedef struct farewell {
    int64_t session;
    char reason[COGRIP_TEXT_BYTES];
    double up_margin_j, line_margin_j; /* nan: not known */
} farewell;

static const char *const decimators[] = {"boxcar", "lowpass", "none"};
static const char *const steps[] = {"passive", "paper"};
static const char *const encoders[] = {"displacement", "velocity"};
static const char *const sides[] = {"left", "right"};
static const char *const concealments[] = {"zero", "repaid", "tank", "elastic"};
static const char *const preferences[] = {"light", "balanced", "stiff"};
static const char *const limits[] = {"none", "auto", "box", "sphere"};
static const char *const roles[] = {"player", "observer"};

static int get_row(reader *from, double *row, uint64_t low, uint64_t high, double bound) {
    const uint64_t count = get_length(from, 0, low, high);
    for (uint64_t place = 0; place < count; place++) row[place] = get_real(from, -bound, bound);
    return (int)count;
}

/* An array inside a message may be longer than its table. Returns its length, so that the rest may be passed over. */
static uint64_t open_array(reader *from, uint64_t low) { return get_length(from, 0, low, UINT32_MAX); }

static void close_array(reader *from, uint64_t length, uint64_t read) {
    for (; read < length && !from->bad; read++) skip(from);
}

static void get_stamp(reader *from, stamp *into) {
    const uint64_t length = open_array(from, 1);
    into->sent_ns = get_int(from, 0, INT64_MAX);
    into->echo_ns = length > 1 ? get_int(from, 0, INT64_MAX) : 0;
    into->held_ns = length > 2 ? get_int(from, 0, INT64_MAX) : 0;
    close_array(from, length, 3);
}

static void put_stamp(writer *to, const stamp *from) {
    put_array(to, 3);
    put_int(to, from->sent_ns);
    put_int(to, from->echo_ns);
    put_int(to, from->held_ns);
}

/* The handle of section 3.6, which comes up only: it is checked, for a message that breaks a rule is malformed. */
static void check_handle(reader *from) {
    if (get_nil(from)) return;
    const uint64_t length = open_array(from, 3);
    get_int(from, 0, UINT32_MAX);
    const uint64_t edges = get_length(from, 0, 0, MOST_EDGES);
    for (uint64_t place = 0; place < edges; place++)
        if (!get_int(from, -32, 32)) from->bad = 1;
    const uint64_t ages = get_length(from, 0, 0, MOST_EDGES);
    for (uint64_t place = 0; place < ages; place++) get_int(from, 0, MOST_AGE);
    if (ages != edges) from->bad = 1;
    if (length > 3 && !get_nil(from)) {
        double turn[4], square = 0.0;
        get_row(from, turn, 4, 4, DBL_MAX);
        for (int place = 0; place < 4; place++) square += turn[place] * turn[place];
        if (!(fabs(square - 1.0) <= UNIT)) from->bad = 1;
    }
    if (length > 4 && !get_nil(from)) get_real(from, -1.0, 1.0);
    close_array(from, length, 5);
}

static void get_waves(reader *from, uint64_t length, waves *into) {
    memset(into, 0, sizeof *into);
    if (length < 11 || length > 17) from->bad = 1;
    into->session = get_int(from, 1, INT64_MAX);
    into->first = get_int(from, 0, MOST_INT);
    into->count = get_row(from, into->wave, 1, MOST_WAVES, 1e4);
    into->totals = get_row(from, into->total, 1, WIRE_AXES, 1e15);
    into->squares_count = get_row(from, into->squares, 1, WIRE_AXES, 1e15);
    into->made_j = get_real(from, -1e15, 1e15);
    into->port_j = get_real(from, -1e15, 1e15);
    into->acknowledged = get_int(from, 0, MOST_INT);
    get_stamp(from, &into->sent);
    into->states = get_row(from, into->state, 2, MOST_STATE, 1e4);
    if (length > 11) into->phase = get_int(from, -(INT64_C(1) << 31), INT64_C(1) << 31);
    if (length > 12) into->applied = get_int(from, 0, MOST_INT);
    if (length > 13) into->impedance_nspm = get_real(from, 0.0, 1e4);
    if (length > 14) into->since = get_int(from, 0, MOST_INT);
    if (length > 15) check_handle(from);
    if (length > 16) into->edges = get_int(from, 0, UINT32_MAX);
}

static void get_intent(reader *from, intent *into) {
    const uint64_t length = open_array(from, 6);
    into->seat = (int)get_int(from, 0, 255);
    into->made_ns = get_int(from, 0, INT64_MAX);
    into->axes = get_row(from, into->place_m, 1, WIRE_AXES, 1e3);
    into->rates = get_row(from, into->rate_mps, 1, WIRE_AXES, 1e4);
    into->stiffness_npm = get_real(from, 0.0, 1e4);
    into->donated_j = get_real(from, 0.0, 1e15);
    close_array(from, length, 6);
}

static void get_partners(reader *from, uint64_t length, told_partners *into) {
    memset(into, 0, sizeof *into);
    if (length < 8 || length > 11) from->bad = 1;
    into->session = get_int(from, 1, INT64_MAX);
    into->number = get_int(from, 0, MOST_INT);
    into->places = get_row(from, into->position_m, 1, WIRE_AXES, 1e3);
    into->rates = get_row(from, into->velocity_mps, 1, WIRE_AXES, 1e4);
    into->count = (int)get_length(from, 0, 0, MOST_PARTNERS);
    for (int place = 0; place < into->count; place++) get_intent(from, &into->intents[place]);
    into->acknowledged = get_int(from, 0, MOST_INT);
    get_stamp(from, &into->sent);
    if (length > 8) check_handle(from);
    if (length > 9) into->edges = get_int(from, 0, UINT32_MAX);
    if (length > 10) into->port_j = get_real(from, -1e15, 1e15);
}

/* True where every list has one number an axis. */
static int partners_of_axes(const told_partners *told, int axes) {
    int fits = told->places == axes && told->rates == axes;
    for (int place = 0; place < told->count; place++)
        fits = fits && told->intents[place].axes == axes && told->intents[place].rates == axes;
    return fits;
}

/* Impairment of a direction that is to be emulated. Returns 1 where there is any. */
static int get_profile(reader *from) {
    static const double low[] = {0, 0, 0, 1, 0, 0, 0, 0, 0}, high[] = {1e4, 1e4, 0.99, 1e4, 0.99, 0.99, 1e7, 1e4, 1e6};
    double value[9];
    int any = 0;
    const uint64_t length = open_array(from, 9);
    for (int place = 0; place < 9; place++) {
        value[place] = get_real(from, low[place], high[place]);
        any = any || (place != 3 && value[place] != 0.0);
    }
    if (value[6] != 0.0 && value[6] < 1.0) from->bad = 1;
    if (value[7] > 0.0 ? value[7] >= value[8] : value[8] != 0.0) from->bad = 1;
    close_array(from, length, 9);
    return any;
}

/* Read a map of `given` of `names`, in any order: each at the place of its name. Returns a bit for each that was there. */
static unsigned get_map(reader *from, const char *const *names, int count, int given, reader *values) {
    unsigned seen = 0;
    const uint64_t length = get_length(from, 1, (uint64_t)given, (uint64_t)given);
    for (int place = 0; place < count; place++) values[place] = *from, values[place].bad = 1;
    for (uint64_t entry = 0; entry < length; entry++) {
        const int place = get_choice(from, names, count);
        if (seen & (1U << place)) from->bad = 1;
        values[place] = *from;
        skip(from);
        seen |= 1U << place;
    }
    for (int place = 0; place < count; place++)
        if (from->bad) values[place].bad = 1, values[place].at = values[place].end = from->end;
    return seen;
}

static void get_coupling(reader *from, settings *into) {
    static const char *const names[] = {"kind", "impedance_nspm", "stiffness_npm", "damping_nspm", "compensate", "decimator",
                                        "lowpass_rad_s", "server_step", "encoder", "rotational_impedance_nms",
                                        "grip_impedance_nspm"};
    reader value[11];
    into->grips = get_map(from, names, 11, 10, value) >> 10 & 1; /* that of turning, or of a gripper */
    get_text(&value[0], into->kind, sizeof into->kind, 1, KIND_BYTES - 1);
    into->impedance_nspm = get_real(&value[1], 1e-3, 1e4);
    into->stiffness_npm = get_real(&value[2], 0.0, 1e7);
    into->damping_nspm = get_real(&value[3], 0.0, 1e4);
    get_bool(&value[4]);
    into->decimator = get_choice(&value[5], decimators, 3);
    into->lowpass_rad_s = get_real(&value[6], 1e-3, 1e5);
    get_choice(&value[7], steps, 2);
    into->velocity_encoder = get_choice(&value[8], encoders, 2);
    if (into->grips) get_real(&value[10], 1e-3, 1e4);
    else get_real(&value[9], 1e-6, 1e2);
    for (int place = 0; place < 9; place++) from->bad |= value[place].bad;
    from->bad |= value[into->grips ? 10 : 9].bad;
}

static void get_object(reader *from, settings *into) {
    static const char *const names[] = {"kind", "mass_kg", "damping_nspm", "axes"};
    reader value[4];
    char kind[65];
    get_map(from, names, 4, 4, value);
    get_name(&value[0], kind, sizeof kind, 64, " .:_-");
    into->scene = !strcmp(kind, "scene");
    into->mass_kg = get_real(&value[1], 1e-6, 1e3);
    into->object_nspm = get_real(&value[2], 0.0, 1e4);
    into->axes = (int)get_int(&value[3], 1, WIRE_AXES);
    if (into->grips != (into->axes == GRIP_AXES)) from->bad = 1;
    for (int place = 0; place < 4; place++) from->bad |= value[place].bad;
}

static void get_playout(reader *from, settings *into) {
    static const char *const names[] = {"frames", "late", "redundancy", "tank_mj", "concealment"};
    static const char *const adaptive[] = {"auto"};
    reader value[5];
    get_map(from, names, 5, 5, value);
    const int head = peek(&value[0]);
    into->automatic = (head >= 0xa0 && head <= 0xbf) || (head >= 0xd9 && head <= 0xdb);
    if (into->automatic) get_choice(&value[0], adaptive, 1);
    else into->playout_frames = (int)get_int(&value[0], 0, 256);
    into->late = get_real(&value[1], 0.0, 0.2);
    into->redundancy = (int)get_int(&value[2], 1, MOST_FRAMES);
    into->tank_mj = get_real(&value[3], 0.0, 1e3);
    into->concealment = get_choice(&value[4], concealments, 4);
    for (int place = 0; place < 5; place++) from->bad |= value[place].bad;
}

static void get_settings(reader *from, settings *into) {
    memset(into, 0, sizeof *into);
    const unsigned char *begin = from->at;
    const uint64_t length = open_array(from, 13);
    get_name(from, into->room, sizeof into->room, 40, " ._-");
    get_name(from, into->user, sizeof into->user, 40, " ._-");
    into->seat = (int)get_int(from, 0, 255);
    get_int(from, 0, MOST_INT);
    if (get_real(from, 0.0, 1e6) == 0.0) from->bad = 1;
    const uint64_t rates = open_array(from, 2);
    into->device_hz = (int)get_int(from, 1, MOST_TICKS);
    into->network_hz = (int)get_int(from, 1, MOST_TICKS);
    close_array(from, rates, 2);
    if (from->bad || into->device_hz % into->network_hz) from->bad = 1;
    get_coupling(from, into);
    into->rendered_npm = get_real(from, 0.0, 1e9);
    get_object(from, into);
    get_choice(from, sides, 2);
    get_playout(from, into);
    into->emulated = get_profile(from);
    into->emulated |= get_profile(from);
    if (length > 13) {
        const uint64_t line = open_array(from, 4);
        into->wave_filter_hz = get_real(from, 0.0, 1e3);
        get_bool(from); /* a client may change b and filter, and need not [5.8] */
        get_bool(from);
        get_choice(from, preferences, 3);
        close_array(from, line, 4);
    }
    into->people = length > 14 ? (int)get_int(from, 1, 256) : 1;
    into->scaled = length > 15 && !get_nil(from);
    if (into->scaled) skip(from);
    into->aided = 0;
    if (length > 16) {
        const uint64_t limit = open_array(from, 2);
        into->aided = get_choice(from, limits, 4) != 0;
        skip(from);
        close_array(from, limit, 2);
    }
    if (length > 17) into->aided |= get_bool(from);
    close_array(from, length, length > 17 ? 18 : length > 15 ? length : 15);
    into->print = UINT64_C(14695981039346656037); /* FNV-1a */
    for (; begin < from->at; begin++) into->print = (into->print ^ *begin) * UINT64_C(1099511628211);
}

static void get_welcome(reader *from, uint64_t length, welcome *into) {
    char digest[33]; /* of the settings: it takes the server's */
    memset(into, 0, sizeof *into);
    if (length < 7 || length > 9) from->bad = 1;
    get_int(from, 0, MOST_INT);
    into->nonce = get_int(from, 0, INT64_MAX);
    into->session = get_int(from, 1, INT64_MAX);
    get_secret(from, digest, sizeof digest);
    get_text(from, NULL, 0, 0, 40);
    get_settings(from, &into->seat);
    if (length > 7) get_secret(from, into->ticket, sizeof into->ticket);
    into->player = length > 8 ? !get_choice(from, roles, 2) : 1;
}

static void get_refusal(reader *from, uint64_t length, refusal *into) {
    memset(into, 0, sizeof *into);
    if (length != 5) from->bad = 1;
    get_int(from, 0, MOST_INT);
    into->nonce = get_int(from, 0, INT64_MAX);
    get_text(from, into->code, sizeof into->code, 0, 40);
    get_text(from, into->reason, sizeof into->reason, 0, 300);
}

static void get_redirect(reader *from, uint64_t length, redirect *into) {
    memset(into, 0, sizeof *into);
    if (length != 4 && length != 5) from->bad = 1;
    get_int(from, 0, MOST_INT);
    into->nonce = get_int(from, 0, INT64_MAX);
    get_text(from, into->places[0], sizeof into->places[0], 0, 60);
    into->count = 1;
    if (length == 5) {
        const uint64_t fronts = get_length(from, 0, 0, MOST_FRONTS);
        for (; into->count <= (int)fronts && !from->bad; into->count++)
            get_text(from, into->places[into->count], sizeof into->places[0], 0, 60);
    }
}

static void get_farewell(reader *from, uint64_t length, farewell *into) {
    memset(into, 0, sizeof *into);
    into->up_margin_j = into->line_margin_j = NAN;
    if (length < 3 || length > 5) from->bad = 1;
    into->session = get_int(from, 1, INT64_MAX);
    get_text(from, into->reason, sizeof into->reason, 0, 300);
    if (length > 3 && !get_nil(from)) {
        const uint64_t seat = open_array(from, 4);
        skip(from);
        into->up_margin_j = get_account_real(from);
        into->line_margin_j = get_account_real(from);
        close_array(from, seat, 3);
    }
    if (length > 4 && !get_nil(from)) {
        reader room = *from;
        close_array(&room, open_array(&room, 4), 0);
        *from = room;
    }
}

/* ---- The sending end of a line [5.2] --------------------------------------------------------- */

typedef struct sender {
    int axes, redundancy;
    int64_t next; /* number of the next frame */
    double wave[MOST_FRAMES][AXES];
    sum total[AXES], squares[AXES]; /* of the frames that no datagram carries any more */
} sender;

static void sender_push(sender *line, const double *frame) {
    double *slot = line->wave[line->next % line->redundancy];
    for (int axis = 0; axis < line->axes; axis++) {
        if (line->next >= line->redundancy) {
            add(&line->total[axis], slot[axis]);
            add(&line->squares[axis], slot[axis] * slot[axis]);
        }
        slot[axis] = frame[axis];
    }
    line->next++;
}

static int sender_frames(const sender *line) { return (int)least_int(line->next, line->redundancy); }

/* ---- The energy ledger of a line's receiver [5.4] -------------------------------------------- */

typedef struct totals {
    int64_t first; /* sums over all frames before this one; -1: none */
    double total[AXES], squares[AXES];
} totals;

typedef struct ledger {
    int axes, disturbed; /* disturbed: something is lost, or may be */
    double credit;       /* squares that each axis may play beyond what was sent [W] */
    int64_t settled;     /* newest frame whose totals are in use */
    sum played[AXES], played_squares[AXES], filled[AXES], compensated[AXES], spent[AXES];
    double lost[AXES], lost_squares[AXES], settled_fillings[AXES];
    struct {
        double played[AXES], squares[AXES], filled[AXES];
    } history[HISTORY]; /* before each frame */
    totals usable;      /* newest ones up to the cursor */
} ledger;

static void ledger_settle(ledger *energy, const totals *sent) {
    const int place = (int)(sent->first % HISTORY);
    energy->settled = sent->first;
    for (int axis = 0; axis < energy->axes; axis++) {
        energy->settled_fillings[axis] = energy->history[place].filled[axis];
        energy->lost[axis] = sent->total[axis] - energy->history[place].played[axis];
        energy->lost_squares[axis] = sent->squares[axis] - energy->history[place].squares[axis];
        if (energy->lost[axis] != 0.0 || energy->lost_squares[axis] != 0.0) energy->disturbed = 1;
    }
    for (int axis = 0; axis < energy->axes && energy->disturbed; axis++)
        energy->lost_squares[axis] -= RESERVE_FRACTION * sent->squares[axis]; /* rounding is no reserve */
}

/* Enter what stands for frame `number`, without compensation, and settle. */
static void ledger_add_played(ledger *energy, int64_t number, const double *frame, const totals *newest) {
    const int64_t cursor = number + 1;
    const int place = (int)(cursor % HISTORY);
    for (int axis = 0; axis < energy->axes; axis++) {
        add(&energy->played[axis], frame[axis]);
        add(&energy->played_squares[axis], frame[axis] * frame[axis]);
        energy->history[place].played[axis] = energy->played[axis].value;
        energy->history[place].squares[axis] = energy->played_squares[axis].value;
        energy->history[place].filled[axis] = energy->filled[axis].value;
    }
    const totals *found = newest ? newest : &energy->usable;
    if (found->first > energy->settled && found->first > cursor - HISTORY) ledger_settle(energy, found);
    energy->usable.first = -1;
}

static void ledger_compensate(ledger *energy, int axis, double wave, double squares) {
    add(&energy->compensated[axis], wave);
    add(&energy->spent[axis], squares);
}

static double ledger_deficit(const ledger *energy, int axis) { return energy->lost[axis] - energy->compensated[axis].value; }

/* Squares that may still be played beyond the frames themselves, credit included [W]. */
static double ledger_allowance(const ledger *energy, int axis) {
    const double filled = energy->filled[axis].value, spent = energy->spent[axis].value;
    const double rounding = BOUND_FRACTION * (energy->credit + filled + fabs(spent));
    return energy->lost_squares[axis] - spent + energy->credit - (filled - energy->settled_fillings[axis]) - rounding;
}

/* Squares that compensation may spend: half of the credit is kept for gaps. */
static double ledger_reserve(const ledger *energy, int axis) {
    return most(0.0, ledger_allowance(energy, axis) - 0.5 * energy->credit);
}

/* ---- The jitter buffer, fixed [5.5] and adaptive [5.6]. Time is counted in device ticks ------ */

typedef struct jitter_buffer {
    int automatic, ticks, frames; /* ticks: M; frames: D of a fixed one */
    double late;
    int64_t repeated, skipped;
    int64_t seen, low, high, run; /* of a fixed one */
    int64_t offset;               /* o; that of the first frame played is 0 */
    int count, newest;            /* of the entries of lateness */
    int64_t recent[WINDOW], sorted[WINDOW];
    int64_t half, most_now, most_before, since_skip, too_long, most_at_first;
    int64_t borders, depth_sum, deepest, shallowest;
} jitter_buffer;

static void buffer_init(jitter_buffer *buffer, const settings *seat, int ticks) {
    memset(buffer, 0, sizeof *buffer);
    buffer->automatic = seat->automatic;
    buffer->frames = seat->playout_frames;
    buffer->late = seat->late;
    buffer->ticks = ticks;
    buffer->most_at_first = (int64_t)floor(START_S * seat->network_hz + 0.5);
    buffer->most_now = buffer->most_before = -(int64_t)DEEPEST * ticks;
    buffer->shallowest = (int64_t)DEEPEST * ticks;
}

/* Number of entries that are at most `x`, or with below = 1 less than it. */
static int buffer_place(const jitter_buffer *buffer, int64_t x, int below) {
    int low = 0, high = buffer->count;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (buffer->sorted[middle] < x || (!below && buffer->sorted[middle] == x)) low = middle + 1;
        else high = middle;
    }
    return low;
}

/* Enter a frame that is there for the first time. lead: its number less that of the frame due next; early: ticks to
 * that one. */
static void buffer_arrived(jitter_buffer *buffer, int64_t lead, int64_t early) {
    if (!buffer->automatic) return;
    const int64_t furthest = (int64_t)DEEPEST * buffer->ticks;
    const int64_t ahead = lead > furthest ? furthest : lead < -furthest ? -furthest : lead * buffer->ticks + early;
    const int64_t x = buffer->offset - most_int(-furthest, least_int(furthest, ahead));
    if (buffer->count == WINDOW) {
        const int place = buffer_place(buffer, buffer->recent[buffer->newest], 1);
        buffer->count--;
        memmove(&buffer->sorted[place], &buffer->sorted[place + 1], sizeof buffer->sorted[0] * (size_t)(buffer->count - place));
    }
    const int place = buffer_place(buffer, x, 0);
    memmove(&buffer->sorted[place + 1], &buffer->sorted[place], sizeof buffer->sorted[0] * (size_t)(buffer->count - place));
    buffer->sorted[place] = x;
    buffer->recent[buffer->newest] = x;
    buffer->newest = (buffer->newest + 1) % WINDOW;
    buffer->count++;
    if (++buffer->half > HALF_QUIET) {
        buffer->half = 1;
        buffer->most_before = buffer->most_now;
        buffer->most_now = x;
    } else if (x > buffer->most_now) {
        buffer->most_now = x;
    }
}

/* Frames behind the newest one at which playing begins. in_hand: older frames that are there. */
static int64_t buffer_begin(jitter_buffer *buffer, int64_t in_hand, int64_t early) {
    if (!buffer->automatic) return buffer->frames;
    const int64_t lead = least_int(in_hand, buffer->most_at_first);
    buffer_arrived(buffer, lead, early);
    return lead;
}

static int64_t buffer_target(const jitter_buffer *buffer) {
    const int64_t quantile = buffer->sorted[buffer->count - 1 - (int)(buffer->late * buffer->count)];
    return least_int(quantile, most_int(buffer->most_now, buffer->most_before));
}

static int64_t buffer_depth(const jitter_buffer *buffer) {
    return buffer->count ? most_int(0, buffer->offset - buffer->sorted[0]) : 0;
}

static int64_t buffer_decide_fixed(jitter_buffer *buffer, int64_t lead, int fresh) {
    if (!fresh) return 0;
    buffer->run = lead < 0 ? buffer->run + 1 : 0;
    if (buffer->run > LATE_RUN) return buffer->ticks;
    if (!buffer->seen) buffer->low = buffer->high = lead;
    buffer->low = least_int(lead, buffer->low);
    buffer->high = most_int(lead, buffer->high);
    if (++buffer->seen < REALIGN_WINDOW) return 0;
    buffer->seen = 0;
    return buffer->low > buffer->frames ? -buffer->ticks : buffer->high < buffer->frames ? buffer->ticks : 0;
}

static int64_t buffer_decide_automatic(jitter_buffer *buffer, int64_t lead, int present) {
    buffer->since_skip++;
    if (!buffer->count) return 0;
    const int64_t excess = buffer->offset - buffer_target(buffer);
    if (excess < 0 && !present) {
        const int late = buffer->count - buffer_place(buffer, buffer->offset, 0);
        if (late > buffer->late * buffer->count) return least_int(buffer->ticks, -excess);
    }
    if (excess < 1) {
        buffer->too_long = 0;
        return 0;
    }
    buffer->too_long++;
    if (buffer->since_skip < SPACING || (present && buffer->too_long <= QUIET) || (!present && lead <= 0)) return 0;
    return excess >= 2 * buffer->ticks ? -buffer->ticks : -1;
}

/* Ticks by which o moves now: above 0 nothing is played for so long; below 0 the frame is played for less, or not at all. */
static int64_t buffer_decide(jitter_buffer *buffer, int64_t lead, int present, int fresh) {
    const int64_t move = buffer->automatic ? buffer_decide_automatic(buffer, lead, present)
        : buffer_decide_fixed(buffer, lead, fresh);
    buffer->repeated += move > 0;
    buffer->skipped += move < 0;
    if (!buffer->automatic) return move;
    if (move < 0) buffer->since_skip = 0;
    buffer->offset += move;
    const int64_t depth = buffer_depth(buffer);
    buffer->borders++;
    buffer->depth_sum += depth;
    buffer->deepest = most_int(depth, buffer->deepest);
    buffer->shallowest = least_int(depth, buffer->shallowest);
    return move;
}

/* ---- The receiving end of a line [5.3, 5.4, 6] ----------------------------------------------- */

typedef struct slot {
    int64_t number;
    int waiting, told;         /* a wave, and what the sender says of its energy up to this frame, is there */
    double wave[AXES], made_j;
    int64_t acknowledged;
    totals before;
} slot;

typedef struct receiver {
    int axes, ticks, begun, anchored, fresh, concealment;
    int gap, played, told; /* of the frame popped last; told: made_j and acknowledged are known of it */
    int64_t cursor, newest, oldest, hold, newest_early, anchor;
    double half_frame_s, made_j, last[AXES];
    int64_t acknowledged; /* by the frame popped last */
    int64_t due_frames, received, applied, late, duplicate, concealed, gap_length, longest_gap;
    sum played_j;
    jitter_buffer buffer;
    ledger energy;
    int64_t recent[RECENT], missing[HISTORY]; /* -1: none */
    slot slots[SLOTS];
} receiver;

static void receiver_init(receiver *line, const settings *seat, int axes) {
    memset(line, 0, sizeof *line);
    line->axes = line->energy.axes = axes;
    line->ticks = seat->device_hz / seat->network_hz;
    line->concealment = seat->concealment;
    line->hold = seat->automatic ? 1 : line->ticks;
    line->half_frame_s = 0.5 / seat->network_hz;
    line->energy.credit = seat->tank_mj * 1e-3 / line->half_frame_s / axes;
    line->energy.usable.first = -1;
    line->newest = -1;
    buffer_init(&line->buffer, seat, line->ticks);
    for (int place = 0; place < RECENT; place++) line->recent[place] = -1;
    for (int place = 0; place < HISTORY; place++) line->missing[place] = -1;
    for (int place = 0; place < SLOTS; place++) line->slots[place].number = -1;
}

/* The place of a frame. No two frames that count at a time share one: they are within HISTORY of the cursor, or of
 * the anchor. */
static slot *receiver_slot(receiver *line, int64_t number) {
    slot *found = &line->slots[number % SLOTS];
    if (found->number != number) {
        memset(found, 0, sizeof *found);
        found->number = number;
        found->before.first = -1;
    }
    return found;
}

static int receiver_is_near(receiver *line, int64_t newest) {
    if (line->begun) return newest <= line->cursor + HISTORY;
    if (!line->anchored) {
        if (newest > FURTHEST_JUMP) return 0;
        line->anchored = 1;
        line->anchor = newest;
    }
    return newest - line->anchor <= HISTORY && line->anchor - newest <= HISTORY;
}

static void receiver_add_totals(receiver *line, const waves *from) {
    ledger *energy = &line->energy;
    if (from->first <= energy->settled) return;
    totals *into;
    if (!line->begun || from->first > line->cursor) into = &receiver_slot(line, from->first)->before;
    else if (from->first >= energy->usable.first) into = &energy->usable;
    else return;
    into->first = from->first;
    memcpy(into->total, from->total, sizeof into->total);
    memcpy(into->squares, from->squares, sizeof into->squares);
}

/* Take in the waves of a message; early: ticks left before the next pop. 0, and nothing changed, if they cannot be of
 * this line. */
static int receiver_take(receiver *line, const waves *from, int64_t early) {
    const int frames = from->count / line->axes;
    const int64_t newest = from->first + frames - 1;
    if (from->count % line->axes || frames > MOST_FRAMES || from->totals != line->axes || from->squares_count != line->axes)
        return 0;
    if (!receiver_is_near(line, newest)) return 0;
    if (line->recent[newest % RECENT] == newest) {
        line->duplicate++;
        return 1;
    }
    line->recent[newest % RECENT] = newest;
    const int64_t cursor = line->begun ? line->cursor : 0;
    if (newest > line->newest) {
        line->newest = newest;
        line->newest_early = early;
        line->fresh = 1;
    }
    for (int frame = 0; frame < frames; frame++) {
        const int64_t number = from->first + frame;
        int64_t *missing = &line->missing[number % HISTORY];
        if (number >= cursor) {
            slot *into = receiver_slot(line, number);
            if (into->waiting) continue;
            into->waiting = 1;
            memcpy(into->wave, &from->wave[frame * line->axes], sizeof into->wave[0] * (size_t)line->axes);
            if (!line->received || number < line->oldest) line->oldest = number;
        } else if (*missing == number) {
            *missing = -1;
            line->late++;
        } else {
            if (line->begun && number == newest && number < cursor - HISTORY)
                buffer_arrived(&line->buffer, number - cursor, early);
            continue;
        }
        line->received++;
        if (line->begun) buffer_arrived(&line->buffer, number - cursor, early);
    }
    if (newest >= cursor) {
        slot *into = receiver_slot(line, newest);
        into->told = 1;
        into->made_j = from->made_j;
        into->acknowledged = from->acknowledged;
    }
    receiver_add_totals(line, from);
    return 1;
}

/* Count frame `number`, which is not played, as late; as missing if it has not come. */
static void receiver_drop(receiver *line, int64_t number) {
    slot *found = receiver_slot(line, number);
    if (found->waiting) line->late++;
    else line->missing[number % HISTORY] = number;
    found->waiting = 0;
}

static void receiver_begin(receiver *line) {
    const int64_t cursor = line->newest - buffer_begin(&line->buffer, line->newest - line->oldest, line->newest_early);
    line->due_frames = most_int(0, cursor);
    /* Totals of frames up to the cursor: the newest are in use. Nothing is older than the anchor's reach. */
    for (int64_t number = most_int(0, line->anchor - HISTORY - MOST_FRAMES); number <= cursor; number++) {
        const slot *found = receiver_slot(line, number);
        if (found->before.first == number && number > line->energy.settled) line->energy.usable = found->before;
    }
    for (int64_t number = most_int(0, cursor - HISTORY); number < cursor; number++) receiver_drop(line, number);
    line->begun = 1;
    line->cursor = cursor;
}

/* Move on from frame `number`, for which `frame` is played. */
static void receiver_advance(receiver *line, int64_t number, const double *frame) {
    line->cursor = number + 1;
    if (number < 0) return;
    int64_t *missing = &line->missing[number % HISTORY];
    if (*missing == number - HISTORY) *missing = -1;
    line->due_frames++;
    const slot *next = receiver_slot(line, number + 1);
    ledger_add_played(&line->energy, number, frame, next->before.first == number + 1 ? &next->before : NULL);
}

static void receiver_fill(const receiver *line, double *frame) {
    for (int axis = 0; axis < line->axes; axis++) {
        const double bound = sqrt(most(0.0, ledger_allowance(&line->energy, axis)));
        frame[axis] = line->concealment >= CONCEAL_TANK ? within(FADE * line->last[axis], bound) : 0.0;
    }
}

/* Enter that this part of a frame is not played; below 0: that it is played as well. */
static void receiver_owe(receiver *line, const double *frame, double part) {
    for (int axis = 0; axis < line->axes; axis++)
        ledger_compensate(&line->energy, axis, -part * frame[axis], -part * frame[axis] * frame[axis]);
}

/* Add this frame's compensation, and count its energy. part: of a frame, for which it is played. */
static void receiver_play(receiver *line, double *frame, double part) {
    double square = 0.0;
    for (int axis = 0; axis < line->axes; axis++) {
        const double value = frame[axis], last = line->last[axis];
        if (line->energy.disturbed && line->concealment != CONCEAL_ZERO) {
            const double deficit = ledger_deficit(&line->energy, axis), reserve = ledger_reserve(&line->energy, axis);
            double p = within(COMPENSATION_FRACTION * deficit, COMPENSATION_LIMIT);
            if (line->concealment >= CONCEAL_TANK) {
                const double reach = sqrt(value * value + most(0.0, reserve - RESERVE_FRAMES * last * last));
                p = most(-value - reach, least(reach - value, p));
            }
            const double played = within(value + p, sqrt(value * value + reserve));
            const double before = value * value, after = played * played;
            ledger_compensate(&line->energy, axis, part * (played - value),
                part * (after - before) + BOUND_FRACTION * (after + before));
            frame[axis] = played;
        }
        square += frame[axis] * frame[axis];
        line->last[axis] = frame[axis];
    }
    add(&line->played_j, part * square * line->half_frame_s);
}

/* Give the wave to apply for `hold` ticks from now on, [sqrt(W)]. */
static void receiver_pop(receiver *line, double *wave) {
    memset(wave, 0, sizeof *wave * AXES);
    line->told = line->played = line->gap = 0;
    if (!line->begun) {
        if (line->newest < 0) return;
        receiver_begin(line);
    }
    int64_t number = line->cursor;
    const int present = number >= 0 && receiver_slot(line, number)->waiting;
    int64_t move = buffer_decide(&line->buffer, line->newest - number, present, line->fresh);
    line->fresh = 0;
    if (move > 0) { /* wait: no frame stands for what is played */
        line->gap = line->energy.disturbed = 1;
        line->hold = move;
        receiver_fill(line, wave);
        receiver_owe(line, wave, -(double)move / line->ticks);
        receiver_play(line, wave, (double)move / line->ticks);
        return;
    }
    if (move == -line->ticks) { /* skip: nothing is played for this frame */
        const double nothing[AXES] = {0.0};
        if (number >= 0) receiver_drop(line, number);
        receiver_advance(line, number, nothing);
        number++;
        move = 0;
    }
    line->hold = line->ticks + move;
    const double part = 1.0 + (double)move / line->ticks;
    if (number >= 0) {
        slot *found = receiver_slot(line, number);
        if (found->waiting) {
            memcpy(wave, found->wave, sizeof found->wave);
            found->waiting = 0;
            line->played = 1;
            line->applied++;
            line->gap_length = 0;
        } else {
            line->missing[number % HISTORY] = number;
            line->gap = line->energy.disturbed = 1;
            line->concealed++;
            line->longest_gap = most_int(line->longest_gap, ++line->gap_length);
            receiver_fill(line, wave);
            for (int axis = 0; axis < line->axes; axis++) add(&line->energy.filled[axis], wave[axis] * wave[axis]);
        }
        line->told = found->told;
        line->made_j = found->made_j;
        line->acknowledged = found->acknowledged;
        found->told = 0;
    }
    receiver_advance(line, number, wave);
    if (move) {
        line->energy.disturbed = 1;
        receiver_owe(line, wave, 1.0 - part);
    }
    receiver_play(line, wave, part);
}

static void receiver_count(const receiver *line, cogrip_link_count *into) {
    into->sent = least_int(line->due_frames, line->newest + 1);
    into->received = line->received;
    into->applied = line->applied;
    into->late = line->late;
    into->lost = into->sent - line->applied - line->late;
    into->duplicate = line->duplicate;
    into->pending = most_int(0, line->newest + 1 - line->due_frames);
}

/* ---- Clocks, delays and accounts [8, 3.9] ---------------------------------------------------- */

typedef struct clock_offset {
    int64_t peer_sent_ns, received_ns, echoed_ns, low_ns, high_ns, read_ns;
    int known;
} clock_offset;

enum { DELAY_BUCKETS = 128 }; /* a quarter of an octave each, from 1 us on */
typedef struct delays {
    uint32_t count[DELAY_BUCKETS];
    uint64_t total;
    double most_ms, newest_ms;
} delays;

static void delays_add(delays *into, int64_t ns) {
    const double us = most(1.0, (double)ns * 1e-3);
    const int bucket = (int)least(4.0 * log2(us), DELAY_BUCKETS - 1);
    into->count[bucket]++;
    into->total++;
    into->newest_ms = (double)ns * 1e-6;
    into->most_ms = most(into->most_ms, into->newest_ms);
}

/* p50, p99, p999 and the largest [ms]; nan where there is none. A percentile is the end of its bucket. */
static void delays_percentiles(const delays *from, double *into) {
    static const double parts[] = {0.5, 0.99, 0.999};
    for (int which = 0; which < 3; which++) {
        uint64_t seen = 0;
        int bucket = 0;
        while (bucket < DELAY_BUCKETS - 1 && (double)(seen += from->count[bucket]) < parts[which] * (double)from->total)
            bucket++;
        into[which] = from->total ? least(from->most_ms, exp2(0.25 * (bucket + 1)) * 1e-3) : NAN;
    }
    into[3] = from->total ? from->most_ms : NAN;
}

typedef struct account {
    int axes, unstable, oscillates, let_go, incidents;
    int waveless; /* without waves there is no account of playout and line */
    double position_m[WIRE_AXES], force_n[WIRE_AXES], peak_force_n, travel_m, felt_npm, predicted_npm, down_margin_j, leak_j;
    cogrip_link_count down;
    double rtt_ms[4], up_ms[4], down_ms[4], late_us[4], work_us[4], offset_ms, uncertainty_ms;
    int64_t ticks_due, ticks_run, repeated, skipped, concealed, longest_gap;
    char state[41], reason[COGRIP_TEXT_BYTES];
    double peak_step_n, depth_frames, least_frames, most_frames;
    double at_limit, controlled, port_leak_j, port_margin_j, port_reserve_j, port_budget_j, port_shake_n;
    double down_reserve_j, peak_torque_nm, line[6];
    int has_effects;
    double least_tank_j, drawn_j, reduced_s;
} account;

static void put_ints(writer *to, const int64_t *values, int count) {
    put_array(to, count);
    for (int place = 0; place < count; place++) put_int(to, values[place]);
}

static void put_account(writer *to, const account *from) {
    const cogrip_link_count *down = &from->down;
    const int64_t counts[] =
        {down->sent, down->received, down->applied, down->lost, down->late, down->duplicate, down->pending};
    put_array(to, 23);
    put_row(to, from->position_m, from->axes);
    put_row(to, from->force_n, from->axes);
    put_real(to, from->peak_force_n);
    put_real(to, from->travel_m);
    put_known(to, from->felt_npm);
    put_known(to, from->predicted_npm);
    put_known(to, from->down_margin_j);
    put_real(to, from->leak_j);
    put_ints(to, counts, 7);
    put_known_row(to, from->rtt_ms, 4);
    put_array(to, 4);
    put_int(to, from->ticks_due);
    put_int(to, from->ticks_run);
    put_known_row(to, from->late_us, 4);
    put_known_row(to, from->work_us, 4);
    put_bool(to, from->unstable);
    put_text(to, from->state, 40);
    put_text(to, from->reason, 280);
    put_real(to, from->peak_step_n);
    if (from->waveless) {
        put_nil(to);
    } else {
        put_array(to, 7);
        put_real(to, from->depth_frames);
        put_real(to, from->least_frames);
        put_real(to, from->most_frames);
        put_int(to, from->repeated);
        put_int(to, from->skipped);
        put_int(to, from->concealed);
        put_int(to, from->longest_gap);
    }
    put_array(to, 4);
    put_known_row(to, from->up_ms, 4);
    put_known_row(to, from->down_ms, 4);
    put_known(to, from->offset_ms);
    put_known(to, from->uncertainty_ms);
    put_array(to, 9);
    put_bool(to, from->oscillates);
    put_real(to, from->at_limit);
    put_real(to, from->controlled);
    put_real(to, from->port_leak_j);
    put_known(to, from->port_margin_j);
    put_int(to, from->let_go);
    put_known(to, from->port_reserve_j);
    put_real(to, from->port_budget_j);
    put_known(to, from->port_shake_n);
    put_known(to, from->down_reserve_j);
    put_real(to, from->peak_torque_nm);
    if (from->waveless) put_nil(to);
    else put_row(to, from->line, 6);
    if (from->has_effects) {
        put_array(to, 3);
        put_real(to, from->least_tank_j);
        put_real(to, from->drawn_j);
        put_real(to, from->reduced_s);
    } else {
        put_nil(to);
    }
    put_int(to, from->incidents);
}

/* ---- Haptic effects [3.18, 7d; docs/theory.md 7.8] -------------------------------------------- */

enum { MOST_EFFECTS = 16, MOST_POINTS = 8, MOST_ENTRIES = 2 * MOST_EFFECTS, MOST_KNOWN = 8 * MOST_EFFECTS };
enum { VISCOUS, VIBRATION, TEXTURE, MAGNET, PATH, ZONE, CURL, CONSTANT, PERTURBATION, CHANNEL, SPRING, EFFECT_KINDS };
enum { STIFFNESS_NPM, DAMPING_NSPM, AMPLITUDE_N, FREQUENCY_HZ, PERIOD_M, RADIUS_M, MOST_PULL_N, SECONDS, EFFECT_NUMBERS };
enum { KEY_KIND = EFFECT_NUMBERS, KEY_PLACE, KEY_SIZE, KEY_DIRECTION, KEY_POINTS, EFFECT_KEYS };

#define PI 3.14159265358979323846
#define MOST_PLACE_M 1e3
#define LEAST_LENGTH_M 1e-4      /* of radius_m, period_m and a path's step */
#define LEAST_FREQUENCY_HZ 1e-3
#define LEAST_DIRECTION 1e-6
#define EFFECT_RAMP_S 0.02       /* in which an effect comes and goes where it is not at rest */
#define MOST_EFFECT_STEP_N 0.5   /* by which an effect that comes or goes may change the force in a tick */
#define LEAST_PULSE_S 0.01       /* of a perturbation */
#define MOST_CURL_TURN 0.2       /* tangent of the angle by which an empty tank turns a curl field towards a damper */
#define STEEPEST 0.28621670111997312 /* of r (1 - r^2)^2, at r^2 = 1/5 */

typedef struct effect {
    int kind, points;
    double place_m[3], size_m[3], direction[3], point_m[MOST_POINTS][3], number[EFFECT_NUMBERS];
} effect;

typedef struct told_effects {
    int64_t session, version, numbers[MOST_EFFECTS], number;
    int count, has_effect;
    double tank_mj;
    struct effect effect;
} told_effects;

static const char *const effect_kinds[] = {"viscous", "vibration", "texture", "magnet", "path", "zone", "curl", "constant",
    "perturbation", "channel", "spring"};
static const char *const effect_keys[] =
    {"stiffness_npm", "damping_nspm", "amplitude_n", "frequency_hz", "period_m", "radius_m", "force_n", "seconds", "kind",
        "place_m", "size_m", "direction", "points_m"};
static const double effect_bounds[] = {1e5, 1e3, 40.0, 256.0, 1.0, 1.0, 40.0, 1e6};

static void get_effect(reader *from, effect *into) {
    const uint64_t keys = get_length(from, 1, 1, UINT32_MAX);
    memset(into, 0, sizeof *into);
    into->kind = -1;
    for (uint64_t place = 0; place < keys && !from->bad; place++) {
        const int key = get_choice(from, effect_keys, EFFECT_KEYS);
        if (from->bad) return;
        switch (key) {
        case KEY_KIND: into->kind = get_choice(from, effect_kinds, EFFECT_KINDS); break;
        case KEY_PLACE: get_row(from, into->place_m, 3, 3, MOST_PLACE_M); break;
        case KEY_DIRECTION: get_row(from, into->direction, 3, 3, MOST_PLACE_M); break;
        case KEY_SIZE:
            get_row(from, into->size_m, 3, 3, MOST_PLACE_M);
            for (int axis = 0; axis < 3; axis++)
                if (into->size_m[axis] < 0.0) from->bad = 1;
            break;
        case KEY_POINTS:
            into->points = (int)get_length(from, 0, 0, MOST_POINTS);
            for (int point = 0; point < into->points; point++) get_row(from, into->point_m[point], 3, 3, MOST_PLACE_M);
            break;
        default: into->number[key] = get_real(from, 0.0, effect_bounds[key]);
        }
    }
    if (into->kind < 0) from->bad = 1;
}

static void get_effects(reader *from, uint64_t length, told_effects *into) {
    memset(into, 0, sizeof *into);
    if (length < 5 || length > 7) from->bad = 1;
    into->session = get_int(from, 1, INT64_MAX);
    into->version = get_int(from, 0, MOST_INT);
    into->count = (int)get_length(from, 0, 0, MOST_EFFECTS);
    for (int place = 0; place < into->count; place++) into->numbers[place] = get_int(from, 0, MOST_INT);
    into->tank_mj = get_real(from, 0.0, 1e3);
    if (length > 5) into->number = get_int(from, 0, MOST_INT);
    if (length > 6 && !get_nil(from)) {
        into->has_effect = 1;
        get_effect(from, &into->effect);
    }
}

/* 1 for what its work alone accounts for; else it is a spring or a damper. */
static int is_active(int kind) {
    return kind == VIBRATION || kind == TEXTURE || kind == CURL || kind == CONSTANT || kind == PERTURBATION;
}

/* 1 for what begins as the hand comes into its box, and not as it is told. */
static int effect_waits(const effect *given) {
    return given->kind == PERTURBATION && (given->size_m[0] != 0.0 || given->size_m[1] != 0.0 || given->size_m[2] != 0.0);
}

/* 1 where the effect can be rendered in so many axes. */
static int effect_fits(const effect *given, int axes) {
    static const int needs[EFFECT_KINDS][2] = {/* viscous on: */ {DAMPING_NSPM, DAMPING_NSPM}, {AMPLITUDE_N, FREQUENCY_HZ},
        {AMPLITUDE_N, PERIOD_M}, {STIFFNESS_NPM, RADIUS_M}, {STIFFNESS_NPM, STIFFNESS_NPM}, {STIFFNESS_NPM, STIFFNESS_NPM},
        /* curl on: */ {DAMPING_NSPM, DAMPING_NSPM}, {MOST_PULL_N, MOST_PULL_N}, {AMPLITUDE_N, SECONDS},
        {STIFFNESS_NPM, STIFFNESS_NPM}, {STIFFNESS_NPM, STIFFNESS_NPM}};
    const double *number = given->number, *direction = given->direction;
    const int kind = given->kind, directed = size_of(direction, axes) >= LEAST_DIRECTION,
        turned = direction[0] != 0.0 || direction[1] != 0.0 || direction[2] != 0.0;
    if (number[needs[kind][0]] == 0.0 || number[needs[kind][1]] == 0.0) return 0;
    if (kind == PATH || kind == CHANNEL) {
        if (given->points < 2 || (kind == CHANNEL && given->points > 2) || axes == 1) return 0;
        for (int point = 1; point < given->points; point++) {
            double step[AXES] = {0.0};
            for (int axis = 0; axis < axes; axis++) step[axis] = given->point_m[point][axis] - given->point_m[point - 1][axis];
            if (size_of(step, axes) < LEAST_LENGTH_M) return 0;
        }
    }
    if (kind == CURL && (axes == 1 || size_of(axes == 2 ? direction + 2 : direction, axes == 2 ? 1 : 3) < LEAST_DIRECTION))
        return 0;
    if ((kind == ZONE ? turned : is_active(kind) && kind != CURL) && !directed) return 0;
    if (kind == PERTURBATION && number[SECONDS] < LEAST_PULSE_S) return 0;
    if (kind == ZONE && !turned && size_of(given->size_m, axes) == 0.0) return 0;
    if (number[PERIOD_M] != 0.0 && number[PERIOD_M] < LEAST_LENGTH_M) return 0;
    if (number[RADIUS_M] != 0.0 && number[RADIUS_M] < LEAST_LENGTH_M) return 0;
    return number[FREQUENCY_HZ] == 0.0 || number[FREQUENCY_HZ] >= LEAST_FREQUENCY_HZ;
}

/* An effect in force. share: w, 0 to 1, the ramp of safety in it; stiffness_npm: K as it is rendered; since: tick with which
 * a perturbation began, -1 while it waits for the hand. */
typedef struct effect_entry {
    effect law;
    int64_t number, begun, since;
    double left_ticks, share, stored_j, unit[AXES], stiffness_npm, most_n, slope_nps, turn, pulse_ticks, now_n;
    int ended, plane, present;
    /* of a passive one, at the hand: */
    int springs, damps;
    double potential_j, spring_n[AXES], damper_n[AXES];
} effect_entry;

/* All effects of the seat. Forces are of all of them, before ramp and limits: `asked` for this tick, `held` by the last one
 * that had any, whose force fades where there is none now. */
typedef struct effects {
    int axes, count, told, asked, held, reduced, shorted, known_count, known_next; /* shorted: the tank did not pay for all */
    int64_t version, less_ticks, known[MOST_KNOWN];
    double tick_s, base_nspm, most_nspm, most_npm, step_m, slope_nps, free_j;
    double capacity_j, level_j, least_level_j, drawn_j, overdrawn_j, damped_j, most_damped_j; /* the tank */
    double now_j, stored_j, work_j; /* now_j: what active forces may draw in this tick */
    double asked_n[AXES], active_n[AXES], damper_n[AXES], law_n[AXES]; /* law_n: with the coupling's */
    effect_entry entry[MOST_ENTRIES];
} effects;

static void tank_set(effects *all, double level_j) {
    all->level_j = level_j;
    all->least_level_j = least(all->least_level_j, level_j);
}

static void tank_fill(effects *all, double energy_j) { all->level_j = least(all->capacity_j, all->level_j + energy_j); }

static void tank_hold(effects *all, double capacity_j) {
    if (all->capacity_j == 0.0) all->level_j = all->least_level_j = capacity_j;
    all->capacity_j = capacity_j;
    tank_set(all, least(all->level_j, capacity_j));
}

/* Enter the hand's work against active forces, below 0 where they gave it energy. */
static void tank_worked(effects *all, double work_j) {
    if (work_j >= 0.0) {
        tank_fill(all, work_j);
        return;
    }
    all->drawn_j -= work_j;
    all->overdrawn_j += most(0.0, -(all->level_j + work_j));
    tank_set(all, most(0.0, all->level_j + work_j));
}

/* Enter the hand's work against dampers: it fills the tank once they have taken more than ever before. */
static void tank_damped(effects *all, double work_j) {
    all->damped_j += work_j;
    if (all->damped_j <= all->most_damped_j) return;
    tank_fill(all, all->damped_j - all->most_damped_j);
    all->most_damped_j = all->damped_j;
}

/* carried_nspm, lag_s: of the device; base_nspm: what the coupling has of that; free_j: what the tank may hold. */
static void effects_fit(effects *all, int axes, double tick_s, double carried_nspm, double lag_s, double base_nspm,
    double speed_mps, double slew_nps, double free_j) {
    all->axes = axes;
    all->tick_s = tick_s;
    all->base_nspm = base_nspm;
    all->most_nspm = carried_nspm;
    all->most_npm = carried_nspm / lag_s;
    all->step_m = speed_mps * tick_s;
    all->slope_nps = least(slew_nps, MOST_SLOPE_NPS);
    all->free_j = free_j;
}

static int effects_know(const effects *all, int64_t number) {
    for (int place = 0; place < all->known_count; place++)
        if (all->known[place] == number) return 1;
    return 0;
}

static int effects_name(const told_effects *told, int64_t number) {
    for (int place = 0; place < told->count; place++)
        if (told->numbers[place] == number) return 1;
    return 0;
}

static void entry_begin(const effects *all, effect_entry *into, const told_effects *told, int64_t tick) {
    const double *number = told->effect.number, size = size_of(told->effect.direction, all->axes);
    const int kind = told->effect.kind;
    memset(into, 0, sizeof *into);
    into->law = told->effect;
    into->number = told->number;
    into->begun = tick;
    into->since = effect_waits(&into->law) ? -1 : tick;
    into->left_ticks = number[SECONDS] != 0.0 && into->since >= 0 ? rint(number[SECONDS] / all->tick_s) : HUGE_VAL;
    into->plane = kind == ZONE && size != 0.0;
    for (int axis = 0; axis < all->axes && size != 0.0; axis++) into->unit[axis] = told->effect.direction[axis] / size;
    into->most_n = number[kind == CONSTANT ? MOST_PULL_N : AMPLITUDE_N];
    into->stiffness_npm = number[STIFFNESS_NPM];
    if (kind == VIBRATION) { /* held over ticks a sine is A sinc(f T): it is divided by that */
        into->turn = number[FREQUENCY_HZ] * all->tick_s;
        const double half = PI * least(into->turn, 0.5);
        into->most_n *= half / sin(half);
        into->slope_nps = 2.0 * PI * number[FREQUENCY_HZ] * number[AMPLITUDE_N];
    }
    if (kind == PERTURBATION) {
        into->pulse_ticks = rint(number[SECONDS] / all->tick_s);
        into->slope_nps = PI * number[AMPLITUDE_N] / (into->pulse_ticks * all->tick_s);
    }
    if (kind == TEXTURE) into->stiffness_npm = 2.0 * PI * number[AMPLITUDE_N] / number[PERIOD_M];
    if (kind == MAGNET && number[MOST_PULL_N] != 0.0)
        into->stiffness_npm = least(into->stiffness_npm, number[MOST_PULL_N] / (STEEPEST * number[RADIUS_M]));
}

/* Take in what the server tells. Returns the count to raise, -1 for none. */
static int effects_tell(effects *all, const told_effects *told, int64_t tick) {
    if (told->version < all->version) return COGRIP_LATE_EFFECTS;
    all->version = told->version;
    tank_hold(all, least(told->tank_mj * 1e-3, all->free_j));
    for (int place = 0; place < all->count; place++)
        if (!effects_name(told, all->entry[place].number)) all->entry[place].ended = 1;
    if (!told->has_effect || effects_know(all, told->number) || !effects_name(told, told->number)) return -1;
    all->known[all->known_next] = told->number;
    all->known_next = (all->known_next + 1) % MOST_KNOWN;
    all->known_count = all->known_count < MOST_KNOWN ? all->known_count + 1 : MOST_KNOWN;
    if (!effect_fits(&told->effect, all->axes) || all->count >= MOST_ENTRIES) return COGRIP_UNFIT_EFFECT;
    int place = 0;
    while (place < all->count && all->entry[place].number != told->number) place++;
    all->count += place == all->count;
    entry_begin(all, &all->entry[place], told, tick);
    all->told = 1;
    return -1;
}

/* End all effects: another server tells its own. */
static void effects_forget(effects *all) {
    all->version = 0;
    all->known_count = all->known_next = 0;
    for (int place = 0; place < all->count; place++) {
        all->entry[place].ended = 1;
        all->entry[place].number = -place - 1;
    }
}

static void effects_leave_out(effects *all) {
    int kept = 0;
    for (int place = 0; place < all->count; place++) {
        if (all->entry[place].ended && all->entry[place].share == 0.0) continue;
        if (kept != place) all->entry[kept] = all->entry[place];
        kept++;
    }
    all->count = kept;
}

/* Render nothing from now on, and let each effect come again: what springs held is lost. */
static void effects_begin_anew(effects *all) {
    all->asked = 0;
    all->stored_j = 0.0;
    for (int place = 0; place < all->count; place++) all->entry[place].share = all->entry[place].stored_j = 0.0;
    effects_leave_out(all);
}

static double dot(const double *one, const double *other, int axes) {
    double total = 0.0;
    for (int axis = 0; axis < axes; axis++) total += one[axis] * other[axis];
    return total;
}

/* The part of a wish that a force is, along it. */
static double part_of(const double *force, const double *wish, int axes) {
    const double square = dot(wish, wish, axes);
    return square != 0.0 ? dot(force, wish, axes) / square : 0.0;
}

/* The part of their force that acts in `held_n`: where coupling and effects cancel out the law is next to 0. */
static double effects_scale(const effects *all, const double *held_n) {
    return least(1.0, most(0.0, part_of(held_n, all->law_n, all->axes)));
}

/* Leave of a force what is not the effects'. */
static void effects_leave(const effects *all, const double *held_n, double *rest_n) {
    const double scale = all->held ? effects_scale(all, held_n) : 0.0;
    for (int axis = 0; axis < AXES; axis++) rest_n[axis] = held_n[axis] - (scale != 0.0 ? scale * all->asked_n[axis] : 0.0);
}

/* Enter a displacement of the hand, over which `held_n` acted. */
static void effects_enter(effects *all, const double *held_n, const double *start_m, const double *end_m) {
    double moved[AXES] = {0.0};
    if (!all->held) return;
    const double scale = effects_scale(all, held_n);
    for (int axis = 0; axis < all->axes; axis++) moved[axis] = end_m[axis] - start_m[axis];
    tank_worked(all, scale * dot(all->active_n, moved, all->axes));
    tank_damped(all, scale * dot(all->damper_n, moved, all->axes));
    all->work_j += scale * dot(all->asked_n, moved, all->axes);
}

static double towards(double value, double goal, double step) {
    return goal > value ? least(goal, value + step) : most(goal, value - step);
}

static int effect_inside(const effects *all, const effect *given, const double *position_m) {
    for (int axis = 0; axis < all->axes; axis++)
        if (given->size_m[axis] != 0.0 && fabs(position_m[axis] - given->place_m[axis]) > given->size_m[axis]) return 0;
    return 1;
}

static double turn_of(double turns) { return sin(2.0 * PI * (turns - floor(turns))); }

/* 1 where an active effect is felt here and now. */
static int effect_present(const effects *all, effect_entry *one, int64_t tick, const double *position_m) {
    const int inside = effect_inside(all, &one->law, position_m);
    if (one->ended) return 0;
    if (one->law.kind != PERTURBATION) return inside;
    if (one->since < 0 && inside) one->since = tick;
    return one->since >= 0 && (double)(tick - one->since) < one->pulse_ticks;
}

/* The force of an active effect, on the law. missing: share of the tank that is not there. */
static void effect_act(const effects *all, const effect_entry *one, int64_t tick, const double *position_m,
    const double *velocity_mps, double missing, double *force_n) {
    double value = 0.0, away[AXES] = {0.0};
    if (one->law.kind == CURL) { /* B n x v, and a damper */
        double axis[3] = {0.0, 0.0, one->law.direction[2]}, speed[3] = {0.0};
        if (all->axes == 3) memcpy(axis, one->law.direction, sizeof axis);
        memcpy(speed, velocity_mps, (size_t)all->axes * sizeof *speed);
        const double damping = one->law.number[DAMPING_NSPM], size = size_of(axis, 3);
        for (int at = 0; at < all->axes; at++) {
            const int next = (at + 1) % 3, last = (at + 2) % 3;
            force_n[at] = damping *
                ((axis[next] * speed[last] - axis[last] * speed[next]) / size + missing * MOST_CURL_TURN * speed[at]);
        }
        return;
    }
    if (one->law.kind == VIBRATION) value = turn_of(one->turn * (double)(tick - one->begun));
    if (one->law.kind == TEXTURE) {
        for (int axis = 0; axis < all->axes; axis++) away[axis] = position_m[axis] - one->law.place_m[axis];
        value = turn_of(dot(one->unit, away, all->axes) / one->law.number[PERIOD_M]);
    }
    if (one->law.kind == CONSTANT) value = -1.0;
    if (one->law.kind == PERTURBATION) {
        const double since = (double)(tick - one->since) / one->pulse_ticks;
        value = since < 1.0 ? -sin(PI * since) : 0.0;
    }
    for (int axis = 0; axis < all->axes; axis++) force_n[axis] = one->most_n * value * one->unit[axis];
}

/* Add the force of active effects, within what the tank holds; which are present is known. gain: of the ramp in this tick. */
static void effects_act(
    effects *all, int64_t tick, const double *position_m, const double *velocity_mps, double gain, double most_b) {
    const double step = all->tick_s / EFFECT_RAMP_S, speed_mps = size_of(velocity_mps, all->axes);
    const double missing = all->capacity_j != 0.0 ? 1.0 - all->level_j / all->capacity_j : 1.0;
    double slope_nps = 0.0, texture_npm = 0.0, most_j = 0.0, part = 1.0;
    for (int place = 0; place < all->count; place++) {
        const effect_entry *one = &all->entry[place];
        if (!one->present) continue;
        slope_nps += one->slope_nps;
        if (one->law.kind == TEXTURE) texture_npm += one->stiffness_npm;
    }
    for (int place = 0; place < all->count; place++) {
        effect_entry *one = &all->entry[place];
        if (!is_active(one->law.kind)) continue;
        double goal = one->present ? gain : 0.0;
        if (one->slope_nps != 0.0 && slope_nps > all->slope_nps) goal *= all->slope_nps / slope_nps;
        if (one->law.kind == TEXTURE && texture_npm > all->most_npm) goal *= all->most_npm / texture_npm;
        if (one->law.kind == CURL) goal *= most_b;
        all->reduced = all->reduced || (goal > 0.0 && goal < gain);
        const int64_t since = one->law.kind == PERTURBATION ? one->since : one->begun;
        const int at_zero = one->slope_nps != 0.0 && since >= 0 && tick - since <= 1; /* then it needs no ramp */
        if (one->share == 0.0 && at_zero) one->share = goal;
        one->now_n = one->law.kind == CURL
            ? one->law.number[DAMPING_NSPM] * hypot(1.0, MOST_CURL_TURN) * speed_mps : one->most_n;
        const double next = towards(one->share, goal, one->now_n > 0.0 ? least(step, MOST_EFFECT_STEP_N / one->now_n) : step);
        one->share = least(next, gain);
        most_j += one->share * one->now_n * all->step_m;
    }
    if (most_j > all->level_j) {
        part = most(0.0, all->level_j) / most_j;
        all->shorted = 1;
    }
    all->now_j = part * most_j;
    for (int place = 0; place < all->count; place++) {
        effect_entry *one = &all->entry[place];
        double force_n[AXES] = {0.0};
        if (!is_active(one->law.kind)) continue;
        one->share *= part;
        if (one->share == 0.0) continue;
        effect_act(all, one, tick, position_m, velocity_mps, missing, force_n);
        for (int axis = 0; axis < all->axes; axis++) all->active_n[axis] += one->share / gain * force_n[axis];
    }
}

static void feel_magnet(effect_entry *one, int axes, const double *away, const double *velocity_mps) {
    const double square = one->law.number[RADIUS_M] * one->law.number[RADIUS_M];
    const double left = 1.0 - dot(away, away, axes) / square, outside_j = one->stiffness_npm * square / 6.0;
    one->potential_j = outside_j;
    if (left <= 0.0) return;
    one->springs = 1;
    one->damps = one->law.number[DAMPING_NSPM] * left * left != 0.0;
    one->potential_j = outside_j * (1.0 - left * left * left);
    for (int axis = 0; axis < axes; axis++) {
        one->spring_n[axis] = one->stiffness_npm * left * left * away[axis];
        one->damper_n[axis] = one->law.number[DAMPING_NSPM] * left * left * velocity_mps[axis];
    }
}

/* Force of a spring over its length, K d up to the most that it pulls with; and its potential. */
static double bounded(const effect_entry *one, double distance, double *stored_j) {
    const double stiffness = one->stiffness_npm, most_n = one->law.number[MOST_PULL_N];
    const double far = most_n != 0.0 ? most_n / stiffness : HUGE_VAL;
    *stored_j = distance > far ? stiffness * far * (distance - 0.5 * far) : 0.5 * stiffness * distance * distance;
    return stiffness * (distance > far ? far : distance);
}

/* Pull to the nearest point, from which the hand is `offset`; its damper is of the motion less `slide`. */
static void feel_tether(
    effect_entry *one, int axes, const double *offset, const double *velocity_mps, const double *slide) {
    const double damping = one->law.number[DAMPING_NSPM], distance = size_of(offset, axes);
    const double force = bounded(one, distance, &one->potential_j);
    one->springs = 1;
    one->damps = damping != 0.0;
    for (int axis = 0; axis < axes; axis++) {
        one->spring_n[axis] = (distance != 0.0 ? force / distance : one->stiffness_npm) * offset[axis];
        one->damper_n[axis] = damping * (velocity_mps[axis] - slide[axis]);
    }
}

/* Pull to the nearest point of a path, or of the line of a channel; the damper is of the motion across. */
static void feel_path(effect_entry *one, int axes, const double *position_m, const double *velocity_mps) {
    double best = HUGE_VAL, slide[AXES] = {0.0}, offset[AXES] = {0.0};
    for (int point = 1; point < one->law.points; point++) {
        const double *begin = one->law.point_m[point - 1];
        double along[AXES] = {0.0}, away[AXES] = {0.0};
        for (int axis = 0; axis < axes; axis++) {
            along[axis] = one->law.point_m[point][axis] - begin[axis];
            away[axis] = position_m[axis] - begin[axis];
        }
        const double square = dot(along, along, axes);
        double share = dot(away, along, axes) / square;
        if (one->law.kind == PATH) share = least(1.0, most(0.0, share));
        for (int axis = 0; axis < axes; axis++) away[axis] -= share * along[axis];
        if (dot(away, away, axes) >= best) continue;
        best = dot(away, away, axes);
        const double speed = dot(along, velocity_mps, axes) / square;
        for (int axis = 0; axis < axes; axis++) {
            offset[axis] = away[axis];
            slide[axis] = speed * along[axis];
        }
    }
    feel_tether(one, axes, offset, velocity_mps, slide);
}

/* Wall around a box, or behind a plane: F = -n max(0, K d - B n v). It only pushes. */
static void feel_zone(effect_entry *one, int axes, const double *away, const double *velocity_mps) {
    double depth = HUGE_VAL, out[AXES] = {0.0};
    int nearest = 0;
    if (one->plane) {
        depth = -dot(one->unit, away, axes);
        memcpy(out, one->unit, sizeof out);
    } else {
        for (int axis = 0; axis < axes; axis++) {
            const double half = one->law.size_m[axis], left = half - fabs(away[axis]);
            if (half == 0.0 || left >= depth) continue;
            depth = left;
            nearest = axis;
        }
        out[nearest] = away[nearest] >= 0.0 ? 1.0 : -1.0;
    }
    if (depth <= 0.0) return;
    const double pushed = bounded(one, depth, &one->potential_j);
    const double total = most(0.0, pushed - one->law.number[DAMPING_NSPM] * dot(out, velocity_mps, axes));
    one->springs = 1;
    one->damps = total != pushed;
    for (int axis = 0; axis < axes; axis++) {
        one->spring_n[axis] = -pushed * out[axis];
        one->damper_n[axis] = (pushed - total) * out[axis];
    }
}

/* What a passive effect does here: its spring, U and damper. */
static void effect_feel(const effects *all, effect_entry *one, const double *position_m, const double *velocity_mps) {
    double away[AXES] = {0.0};
    one->springs = one->damps = 0;
    one->potential_j = 0.0;
    memset(one->spring_n, 0, sizeof one->spring_n);
    memset(one->damper_n, 0, sizeof one->damper_n);
    for (int axis = 0; axis < all->axes; axis++) away[axis] = position_m[axis] - one->law.place_m[axis];
    switch (one->law.kind) {
    case MAGNET: feel_magnet(one, all->axes, away, velocity_mps); break;
    case SPRING: {
        const double still[AXES] = {0.0};
        feel_tether(one, all->axes, away, velocity_mps, still);
        break;
    }
    case PATH:
    case CHANNEL: feel_path(one, all->axes, position_m, velocity_mps); break;
    case ZONE: feel_zone(one, all->axes, away, velocity_mps); break;
    default:
        one->damps = effect_inside(all, &one->law, position_m);
        for (int axis = 0; axis < all->axes && one->damps; axis++)
            one->damper_n[axis] = one->law.number[DAMPING_NSPM] * velocity_mps[axis];
    }
}

/* Let w of a spring go towards its goal, as far as the tank pays for it: w' U - w U. */
static void effect_pay(effects *all, effect_entry *one, double goal, double gain) {
    const double before = one->share, step = all->tick_s / EFFECT_RAMP_S, potential_j = one->potential_j;
    double share;
    if (potential_j == 0.0 && !one->springs) {
        share = goal > before ? goal : towards(before, goal, step);
    } else {
        const double size = size_of(one->spring_n, all->axes);
        share = towards(before, goal, size > 0.0 ? least(step, MOST_EFFECT_STEP_N / size) : step);
        const double paid = potential_j != 0.0 ? before + most(0.0, all->level_j - all->now_j) / potential_j : HUGE_VAL;
        if (share > before && share > paid) {
            share = paid;
            all->shorted = 1;
        }
    }
    one->share = share = least(share, gain);
    if (share > before) tank_set(all, most(0.0, all->level_j - (share - before) * potential_j));
    else if (share < before) tank_fill(all, (before - share) * potential_j);
    one->stored_j = share * potential_j;
}

/* Add the forces of springs and dampers, which are felt already; what springs cost is paid. Springs stay within what the
 * device carries; most_b: the share of dampers that does. */
static void effects_resist(effects *all, double gain, double most_b, double *spring_n) {
    double stiffness = 0.0;
    for (int place = 0; place < all->count; place++) {
        const effect_entry *one = &all->entry[place];
        if (!is_active(one->law.kind) && one->springs) stiffness += one->stiffness_npm;
    }
    const double most_k = stiffness > 0.0 ? least(1.0, all->most_npm / stiffness) : 1.0;
    all->reduced = all->reduced || most_k < 1.0;
    all->stored_j = 0.0;
    for (int place = 0; place < all->count; place++) {
        effect_entry *one = &all->entry[place];
        if (is_active(one->law.kind)) continue;
        effect_pay(all, one, one->ended ? 0.0 : gain * most_k, gain);
        all->stored_j += one->stored_j;
        if (one->share == 0.0 || gain == 0.0) continue;
        for (int axis = 0; axis < all->axes; axis++) {
            spring_n[axis] += one->share / gain * one->spring_n[axis];
            all->damper_n[axis] += one->share / gain * most_b * one->damper_n[axis];
        }
    }
}

/* Find the force of all effects until the next tick, before the ramp of this gain. */
static void effects_step(
    effects *all, int64_t tick, const double *position_m, const double *velocity_mps, double gain) {
    double spring_n[AXES] = {0.0}, damping = 0.0;
    all->asked = all->held = all->count > 0;
    all->reduced = all->shorted = 0;
    all->now_j = 0.0;
    memset(all->active_n, 0, sizeof all->active_n);
    memset(all->damper_n, 0, sizeof all->damper_n);
    if (!all->asked) {
        all->stored_j = 0.0;
        return;
    }
    effects_leave_out(all);
    for (int place = 0; place < all->count; place++)
        if ((double)(tick - all->entry[place].begun) >= all->entry[place].left_ticks) all->entry[place].ended = 1;
    for (int place = 0; place < all->count; place++) {
        effect_entry *one = &all->entry[place];
        if (is_active(one->law.kind)) one->present = effect_present(all, one, tick, position_m);
        else effect_feel(all, one, position_m, velocity_mps);
        if (one->law.kind == CURL ? one->present : one->damps) damping += one->law.number[DAMPING_NSPM];
    }
    /* Dampers and curl fields have what the coupling leaves of what the device carries. */
    const double most_b = damping > 0.0 ? least(1.0, most(0.0, all->most_nspm - all->base_nspm) / damping) : 1.0;
    all->reduced = most_b < 1.0;
    effects_act(all, tick, position_m, velocity_mps, gain, most_b);
    effects_resist(all, gain, most_b, spring_n);
    all->less_ticks += all->reduced || all->shorted;
    for (int axis = 0; axis < all->axes; axis++)
        all->asked_n[axis] = all->active_n[axis] + spring_n[axis] + all->damper_n[axis];
}

/* ---- Models of partners [7e; docs/theory.md 5b] ------------------------------------------------ */

/* The numbers of the reference. A hand of this client is always told to be of HAND_NPM: it does not estimate its stiffness. */
#define HAND_NPM 150.0        /* k */
#define HAND_NSPM 5.0         /* b_e */
#define SMOOTHING_S 0.01      /* tau of the intention */
#define RATE_S 0.04           /* tau_r of its rate */
#define MOST_INTENT_MPS 1.0
#define MODEL_KG 0.1          /* m_d */
#define ADDED_NSPM 10.0       /* b_m above b_e, of a hand of DAMPED_NPM or more whose intention is LATE_S old */
#define LATE_S 0.04
#define DRIFTING 0.5          /* part of the added damping that acts against the drift of an intention */
#define DRIFT_S 0.1
#define DAMPED_NPM 150.0
#define HORIZON_S 0.1         /* h */
#define GROW_S 0.5            /* in which the stiffness of a hand grows that has just come */
#define SILENT_S 0.3          /* without news of a partner, after which its model lets go within as long */
#define GATE_J 0.05           /* E_0 */
#define GATE_CAP_J (GATE_J + 0.1)
#define GATE_FADE_S 0.02      /* tau_s */
#define DAMPED_J 0.001        /* D: below it the damper acts alone */
#define DONATED_S 0.05
#define DAMPER_MPS 0.1
#define DAMPER_AHEAD 1.5
#define REFILL_W 0.02
#define REST_MPS 0.01
#define REST_S 0.25

/* Ledger of one person's own spring; client/cogrip/client/coupling/partner/spring_gate.py has its law. */
typedef struct gate {
    sum work;
    double donated_j, credited_j, coming_j, refilled_j, spilt_j, spare_before_j, rested_s, worked_j, tick_s;
    int below, gave_out;
} gate;

static void gate_init(gate *own, double tick_s) {
    memset(own, 0, sizeof *own);
    own->tick_s = tick_s;
    own->spare_before_j = GATE_J - DAMPED_J;
}

/* What came in but by the hand itself, less what was given away; then all that came in; then b, with E_0. */
static double gate_granted_j(const gate *own) {
    return own->credited_j + own->refilled_j - own->donated_j - own->spilt_j;
}

static double gate_reserve_j(const gate *own) { return own->work.value + gate_granted_j(own); }
static double gate_budget_j(const gate *own) { return GATE_J + gate_reserve_j(own); }

/* The part of a stretch that may stay, of 1: step (1) of the gate. */
static double gate_cut(const gate *own, const double *stretch_m, int axes, double stiffness_npm) {
    if (stiffness_npm == 0.0) return 1.0;
    const double kept_j = most(0.0, own->spare_before_j) * (1.0 - own->tick_s / GATE_FADE_S);
    const double bound = 2.0 * most(0.0, gate_budget_j(own) - DAMPED_J - kept_j) / stiffness_npm;
    const double square = dot(stretch_m, stretch_m, axes);
    return square <= bound ? 1.0 : sqrt(bound / square);
}

/* Reduce the damper's force to what may act, and settle the tick: steps (2) and (3), and the refill at rest. */
static void gate_pay(
    gate *own, const double *stretch_m, double stiffness_npm, double *damper_n, const double *velocity_mps, double damping_nspm,
    int axes) {
    const double stored_j = 0.5 * stiffness_npm * dot(stretch_m, stretch_m, axes), speed_mps = size_of(velocity_mps, axes);
    const double come_j = own->coming_j * least(1.0, own->tick_s / DONATED_S); /* at once it would be a step of force */
    own->coming_j -= come_j;
    own->credited_j += come_j;
    own->rested_s = speed_mps < REST_MPS ? own->rested_s + own->tick_s : 0.0;
    const double missing_j = GATE_J - (gate_budget_j(own) - stored_j);
    if (own->rested_s >= REST_S && missing_j > 0.0) own->refilled_j += least(REFILL_W * own->tick_s, missing_j);
    double free_j = gate_budget_j(own) - stored_j;
    const double worked_j = own->work.value - own->worked_j;
    own->worked_j = own->work.value;
    if (gate_budget_j(own) < DAMPED_J) {
        const int below = gate_budget_j(own) < 0.0;
        own->gave_out = below && (own->gave_out || (own->below && worked_j < 0.0));
        own->below = below;
        for (int axis = 0; axis < axes; axis++) damper_n[axis] = own->gave_out ? 0.0 : damping_nspm * velocity_mps[axis];
        own->spare_before_j = free_j - DAMPED_J;
        return;
    }
    own->below = own->gave_out = 0;
    if (dot(damper_n, velocity_mps, axes) < 0.0) {
        const double take_j = size_of(damper_n, axes) * most(DAMPER_AHEAD * speed_mps, DAMPER_MPS) * GATE_FADE_S;
        const double part = take_j > free_j - DAMPED_J ? most(0.0, free_j - DAMPED_J) / take_j : 1.0;
        for (int axis = 0; axis < axes; axis++) damper_n[axis] *= part;
    }
    if (free_j > GATE_CAP_J) {
        own->spilt_j += free_j - GATE_CAP_J;
        free_j = GATE_CAP_J;
    }
    if (free_j > GATE_J) {
        const double given_j = (free_j - GATE_J) * least(1.0, own->tick_s / DONATED_S);
        own->donated_j += given_j;
        free_j -= given_j;
    }
    own->spare_before_j = free_j - DAMPED_J;
}

/* Where the hand would be if nothing held it. */
typedef struct intention {
    double place_m[AXES], rate_mps[AXES];         /* e, e' */
    double smooth_m[AXES], force_n[AXES], velocity_mps[AXES]; /* of the hand, through one pole */
} intention;

static void intention_begin(intention *own, const double *position_m, int axes) {
    memset(own, 0, sizeof *own);
    for (int axis = 0; axis < axes; axis++) own->place_m[axis] = own->smooth_m[axis] = position_m[axis];
}

static void intention_update(
    intention *own, const double *position_m, const double *velocity_mps, const double *force_n, double mass_kg, double tick_s,
    int axes) {
    const double pole = tick_s / SMOOTHING_S;
    for (int axis = 0; axis < axes; axis++) {
        double moved = pole * (position_m[axis] - own->smooth_m[axis]);
        const double pushed = pole * (force_n[axis] - own->force_n[axis]);
        const double gained = pole * (velocity_mps[axis] - own->velocity_mps[axis]);
        own->smooth_m[axis] += moved;
        own->force_n[axis] += pushed;
        own->velocity_mps[axis] += gained;
        own->place_m[axis] = own->smooth_m[axis]
            + (own->force_n[axis] + HAND_NSPM * own->velocity_mps[axis] + mass_kg * gained / tick_s) / HAND_NPM;
        moved += (pushed + HAND_NSPM * gained) / HAND_NPM;
        const double rate = own->rate_mps[axis] + tick_s / RATE_S * (moved / tick_s - own->rate_mps[axis]);
        own->rate_mps[axis] = within(rate, MOST_INTENT_MPS);
    }
}

/* One partner as it was told last, and the model of its hand. */
typedef struct partner {
    intent told; /* axes 0: nothing yet */
    int counted; /* its counter of donated energy is known */
    double age_s, silent_s, share, donated_j; /* share: of its stiffness that the model has: it grows in GROW_S */
    double place_m[AXES], velocity_mps[AXES], intention_m[AXES], drift_mps[AXES], stiffness_npm; /* of the model */
} partner;

/* Step object and models by one tick on one axis: implicit Euler (docs/theory.md 5b). own: place and velocity of the hand. */
static void step_copy(
    int axis, double tick_s, double *place_m, double *velocity_mps, double mass_kg, double object_nspm, double K, double B,
    partner *known, int count, const double *own) {
    double drive[MOST_PARTNERS], inertia[MOST_PARTNERS];
    const double o = *place_m, G = K * tick_s + B;
    double pull = mass_kg * *velocity_mps + tick_s * (K * (own[0] - o) + B * own[1]);
    double weight = mass_kg + tick_s * object_nspm + tick_s * G;
    for (int place = 0; place < count; place++) {
        const partner *one = &known[place];
        if (!one->told.axes) continue;
        const double k = one->stiffness_npm, stretch = one->place_m[axis] - o;
        const double added = ADDED_NSPM * least(1.0, one->age_s / LATE_S) * least(1.0, k / DAMPED_NPM);
        const double damping = HAND_NSPM * least(1.0, k / DAMPED_NPM) + added;
        inertia[place] = MODEL_KG + tick_s * (k * tick_s + damping + G);
        const double pull_n = k * (one->intention_m[axis] - one->place_m[axis]) + DRIFTING * added * one->drift_mps[axis];
        drive[place] = MODEL_KG * one->velocity_mps[axis] + tick_s * (pull_n - K * stretch);
        pull += tick_s * K * stretch + tick_s * G * drive[place] / inertia[place];
        weight += tick_s * G - (tick_s * G) * (tick_s * G) / inertia[place];
    }
    const double v = pull / weight;
    for (int place = 0; place < count; place++) {
        partner *one = &known[place];
        if (!one->told.axes) continue;
        one->velocity_mps[axis] = (drive[place] + tick_s * G * v) / inertia[place];
        one->place_m[axis] += tick_s * one->velocity_mps[axis];
    }
    *velocity_mps = v;
    *place_m = o + tick_s * v;
}

/* The receiving end of a line whose newest message wins [7]. */
typedef struct latest {
    int64_t newest, last_number; /* received, popped; -1 before the first */
    int64_t seen[LATEST_HISTORY], received, applied, late, duplicate; /* seen: number + 1 */
    int waiting;
    told_partners next;
} latest;

static void latest_init(latest *line) {
    memset(line, 0, sizeof *line);
    line->newest = line->last_number = -1;
}

static int latest_take(latest *line, const told_partners *told) {
    if (told->number <= line->newest - LATEST_HISTORY || told->number > line->newest + FURTHEST_JUMP) return 0;
    int64_t *seen = &line->seen[told->number % LATEST_HISTORY];
    if (*seen == told->number + 1) {
        line->duplicate++;
        return 1;
    }
    *seen = told->number + 1;
    line->received++;
    const int overtaken = told->number < line->newest;
    line->late += overtaken || line->waiting;
    if (overtaken) return 1;
    line->newest = told->number;
    line->next = *told;
    line->waiting = 1;
    return 1;
}

static int latest_pop(latest *line) {
    if (!line->waiting) return 0;
    line->waiting = 0;
    line->applied++;
    line->last_number = line->next.number;
    return 1;
}

static void latest_count(const latest *line, cogrip_link_count *into) {
    const int64_t sent = line->newest + 1 - line->waiting;
    const cogrip_link_count count = {
        sent, line->received, line->applied, sent - line->applied - line->late, line->late, line->duplicate, line->waiting};
    *into = count;
}

/* One's own copy of the object, held by one's own spring and by a model of each partner's hand. */
typedef struct partners {
    struct gate gate;
    double worked_j, granted_j; /* of the gate as this line began */
    intention own;
    int held; /* there is a copy: a hand holds it */
    double place_m[AXES], velocity_mps[AXES], applied_n[AXES], here_s, hold, stored_j;
    int64_t elapsed, clock_ns; /* clock_ns: the server's, as this frame began; 0 not known */
    partner known[MOST_PARTNERS];
    int count, others; /* others: seats of the room beside this */
    latest down;
} partners;

/* ---- The client ------------------------------------------------------------------------------ */

/* A one-pole filter of a wave, passive for any lengths that its inputs are held [5.8]. */
typedef struct wave_filter {
    double lag_ticks, content[AXES];
} wave_filter;

static void filter_step(wave_filter *filter, double *wave, int axes, int64_t ticks) {
    if (filter->lag_ticks == 0.0) return;
    for (int axis = 0; axis < axes; axis++) {
        const double x = wave[axis];
        wave[axis] = (filter->content[axis] + (double)ticks * x) / (filter->lag_ticks + (double)ticks);
        filter->content[axis] += (double)ticks * (x - wave[axis]);
    }
}

/* All that a new session of a seat begins anew: one line in each direction [5]. */
typedef struct line {
    sender up;
    receiver down;
    wave_filter up_filter, down_filter;
    double decimated[AXES], withheld[AXES], returning[AXES];
    sum made, used, given; /* at the port, up to the last frame that ended; given: by the line, less what it took */
    double made_now_j, used_now_j;
    double reserve_j; /* least balance of the line down after its first second: inf before one is known */
    int64_t popped;
    int64_t ticks, began, applied, phase, shift, shifted, asked; /* [5.7]; shifted: -1 before the first shift */
    int64_t spare, acknowledged;                                 /* newest of the server */
} line;

typedef struct handle {
    uint32_t buttons, said; /* said: what the server knows once it has all edges */
    int known, turned, count;
    int edged, at_once; /* an edge was in no message yet; messages that may be sent before the next frame's */
    int64_t first; /* number of the oldest edge that is not acknowledged */
    int8_t edge[MOST_EDGES];
    int64_t tick[MOST_EDGES];
    double orientation[4], grip_m;
} handle;

typedef struct message {
    size_t bytes;
    int hello;
    unsigned char data[COGRIP_MESSAGE_BYTES];
} message;

/* A coupling scheme: what a client does with a hand and the server's messages. */
typedef struct coupling {
    const char *kind; /* coupling.kind of the settings */
    int tag;          /* of the message of a frame, both ways */
    double (*damper_nspm)(const settings *seat); /* that it renders */
    void (*begin)(cogrip_client *client, double most_credit);
    /* mean: of the displacement in the tick; goes_on: what the line is told, which of a hand that leaves goes on as it was;
     * hold: how firmly that still holds, from 1 down to 0 */
    void (*elapse)(cogrip_client *client, const double *mean, const double *goes_on, double hold);
    void (*elapse_absent)(cogrip_client *client);
    int64_t (*end_frame)(cogrip_client *client, double spare_j); /* returns the ticks of the next */
    void (*start_frame)(cogrip_client *client, int64_t tick);
    void (*law)(cogrip_client *client, double *force);
    void (*write)(cogrip_client *client, message *into, int64_t now_ns);
    void (*count)(const cogrip_client *client, cogrip_link_count *into);
} coupling;

struct cogrip_client {
    /* Session [4] */
    cogrip_config config;
    char asked_room[161], asked_name[161], token[MOST_TOKEN + 1], device[201], software[41];
    cogrip_state state;
    int64_t since_ns, next_ns, last_received_ns, fresh_ns, newest_sent_ns;
    int64_t hand_session, hand_changes, hand_reports; /* changes taken, and reports made, in this session [3.17] */
    int begun, ending; /* begun: a frame of this session has been taken in; ending: cogrip_leave was called */
    int64_t ending_ns, parting; /* parting: frames made when the object had been released, -1 before */
    welcome seat;      /* session 0: there has been none */
    farewell goodbye;
    clock_offset clock;
    delays rtt, up_ms, down_ms;
    char failed[COGRIP_TEXT_BYTES + 200], reason[COGRIP_TEXT_BYTES], unknown[COGRIP_TEXT_BYTES];
    message leaving;
    message outbox[OUTBOX];
    int outbox_first, outbox_count;
    uint64_t counts[COGRIP_COUNTS];

    /* Seat */
    int axes, ticks_per_frame;
    const coupling *scheme;
    double tick_s, b, root, most_wave, damper_nspm, carried_nspm, lag_s;
    struct line line;
    struct partners partners;
    struct handle handle;
    int64_t tick, first_tick, acted, wave_end, frame_begin, frame_end, ticks_run, stopped; /* stopped: tick of the leave, -1 */
    int has_origin, has_offset;
    double offset_m[AXES]; /* by which jumps have displaced the device's positions */
    double origin_m[AXES], position_m[AXES], start_m[AXES], velocity_mps[AXES], start_mps[AXES], mean_mps[AXES],
        object[2 * AXES];
    double frame_start_m[AXES];
    int estimating;
    double estimate_m[AXES], estimate_mps[AXES];
    double deflection_m[AXES], cut_n[AXES], ratio; /* series impedance */
    int deflected, cut;

    struct effects effects;

    /* Safety */
    cogrip_safety safety;
    char why[COGRIP_TEXT_BYTES];
    double gain, law_n[AXES], force_n[AXES], absent_ticks;
    int unstable, saturated;
    int64_t at_limit, soft_ticks, limited_ticks, controlled_ticks, forced_ticks;

    /* Device port (docs/device_port.md) */
    double free_j, faded_j, reserve_j, balance_j, least_j, later_j, own_j, cut_j, forgiven_j, given_j;
    int ramped, controlled;
    sum work;
    double closed_given_j, closed_port_j, least_leak_j;

    /* Accounts */
    cogrip_link_count closed_down;
    double down_margin_j, down_reserve_j, peak_force_n, peak_step_n, travel_m;
};

typedef char cogrip_client_fits[sizeof(struct cogrip_client) <= COGRIP_CLIENT_BYTES ? 1 : -1];

static const char *const count_names[COGRIP_COUNTS] = {
    "malformed", "unexpected", "other session", "other nonce", "unfit", "before the first tick", "implausible stamp",
    "wave beyond what the device can bring about", "force clipped", "slew limited", "absent sample", "fault",
    "button edges left out", "outbox full", "too large", "not encrypted", "socket errors", "handshake begun again", "resumed",
    "line begun anew", "late effects", "unfit effect"};

static const char *const safety_names[] = {"idle", "live", "degraded", "fault"};

static void say(char *into, size_t bytes, const char *text) {
    if (into && bytes) copy_text(into, bytes, text);
}

/* ---- Sending --------------------------------------------------------------------------------- */

static writer open_message(message *into) {
    const writer to = {into->data, into->data + sizeof into->data, 0};
    into->hello = 0;
    into->bytes = 0;
    return to;
}

static void close_message(message *into, const writer *to) { into->bytes = to->full ? 0 : (size_t)(to->at - into->data); }

static message *outbox_push(cogrip_client *client) {
    if (client->outbox_count == OUTBOX) { /* nobody sends: the oldest is of least use */
        client->counts[COGRIP_OUTBOX_FULL]++;
        client->outbox_first = (client->outbox_first + 1) % OUTBOX;
        client->outbox_count--;
    }
    return &client->outbox[(client->outbox_first + client->outbox_count++) % OUTBOX];
}

static void write_hello(const cogrip_client *client, message *into) {
    static const unsigned char zeros[HELLO_BYTES] = {0};
    const cogrip_config *config = &client->config;
    const welcome *seat = &client->seat;
    const int again = seat->session != 0;
    writer to = open_message(into);
    put_array(&to, 19);
    put_int(&to, TAG_HELLO);
    put_text(&to, "cogrip", 6);
    put_int(&to, COGRIP_PROTOCOL);
    put_text(&to, client->software, 40);
    put_int(&to, (int64_t)config->nonce);
    put_text(&to, again ? seat->seat.room : client->asked_room, 160);
    put_text(&to, again ? seat->seat.user : client->asked_name, 160);
    put_text(&to, "", 0); /* digest: it takes the server's settings */
    put_text(&to, client->device, 200);
    put_int(&to, config->axes);
    put_real(&to, config->rate_hz);
    put_real(&to, least(config->peak_force_n, NO_BOUND));
    put_real(&to, least(config->speed_mps, NO_BOUND));
    put_text(&to, "player", 6);
    put_text(&to, client->token, MOST_TOKEN);
    put_text(&to, again ? seat->ticket : "", 32);
    put_real(&to, 0.0);
    put_real(&to, 0.0);
    const size_t before = (size_t)(to.at - into->data) + 3;
    const size_t padding = before < HELLO_BYTES ? HELLO_BYTES - before : 0;
    put_head(&to, 0xc5, padding, 2);
    put_bytes(&to, zeros, padding);
    close_message(into, &to);
    into->hello = 1;
}

static stamp stamp_now(const cogrip_client *client, int64_t now_ns) {
    const clock_offset *clock = &client->clock;
    const stamp sent = {now_ns, clock->peer_sent_ns, clock->peer_sent_ns ? now_ns - clock->received_ns : 0};
    return sent;
}

static void write_heartbeat(const cogrip_client *client, message *into, int64_t now_ns) {
    const stamp sent = stamp_now(client, now_ns);
    writer to = open_message(into);
    put_array(&to, 3);
    put_int(&to, TAG_HEARTBEAT);
    put_int(&to, client->seat.session);
    put_stamp(&to, &sent);
    close_message(into, &to);
}

/* Answer a change of the hand's settings, which this client has not: all stays as it is [3.17]. */
static void write_hand(cogrip_client *client, message *into) {
    static const double unturned[4] = {1.0, 0.0, 0.0, 0.0};
    writer to = open_message(into);
    put_array(&to, 5);
    put_int(&to, TAG_SET_HAND);
    put_int(&to, client->seat.session);
    put_int(&to, ++client->hand_reports);
    put_int(&to, client->hand_changes);
    put_array(&to, 6);
    put_real(&to, 1.0);
    put_real(&to, 1.0);
    put_row(&to, unturned, 4);
    put_bool(&to, 0);
    put_array(&to, 2);
    put_text(&to, limits[0], 4);
    put_array(&to, 0);
    put_bool(&to, 0);
    close_message(into, &to);
}

/* Answer which of these effects have come, those that were refused included [3.18]. */
static void write_effects(const cogrip_client *client, message *into, const told_effects *told) {
    writer to = open_message(into);
    int known = 0;
    for (int place = 0; place < told->count; place++) known += effects_know(&client->effects, told->numbers[place]);
    put_array(&to, 7);
    put_int(&to, TAG_EFFECTS);
    put_int(&to, told->session);
    put_int(&to, told->version);
    put_array(&to, known);
    for (int place = 0; place < told->count; place++)
        if (effects_know(&client->effects, told->numbers[place])) put_int(&to, told->numbers[place]);
    put_real(&to, told->tank_mj);
    put_int(&to, told->number);
    put_nil(&to);
    close_message(into, &to);
}

static void write_leave(message *into, int64_t session, const char *reason, const account *report) {
    writer to = open_message(into);
    put_array(&to, 4);
    put_int(&to, TAG_LEAVE);
    put_int(&to, session);
    put_text(&to, reason, LEAVE_TEXT_BYTES);
    if (report) put_account(&to, report);
    else put_nil(&to);
    close_message(into, &to);
}

/* Queue the edges of buttons since the last call [5.9]. */
static void handle_edges(cogrip_client *client) {
    handle *hand = &client->handle;
    for (int button = 0; button < 32; button++) {
        const uint32_t bit = UINT32_C(1) << button;
        if (!((hand->buttons ^ hand->said) & bit) || hand->count == MOST_EDGES) continue;
        hand->edge[hand->count] = (int8_t)(hand->buttons & bit ? button + 1 : -(button + 1));
        hand->tick[hand->count++] = client->tick;
        hand->said ^= bit;
        hand->edged = 1;
    }
}

static void put_handle(const cogrip_client *client, writer *to) {
    const handle *hand = &client->handle;
    if (!hand->known) {
        put_nil(to);
        return;
    }
    put_array(to, 5);
    put_int(to, hand->first);
    put_array(to, hand->count);
    for (int place = 0; place < hand->count; place++) put_int(to, hand->edge[place]);
    put_array(to, hand->count);
    for (int place = 0; place < hand->count; place++) put_int(to, least_int(client->tick - hand->tick[place], MOST_AGE));
    if (hand->turned) put_row(to, hand->orientation, 4);
    else put_nil(to);
    put_known(to, hand->grip_m);
}

/* Tell edges within a frame: no more than MOST_AT_ONCE times, as the server bounds what a peer sends [5.9]. */
static void write_edges(cogrip_client *client, int64_t now_ns) {
    const stamp sent = stamp_now(client, now_ns);
    message *into;
    writer to;
    if (!client->handle.edged || !client->handle.at_once) return;
    client->handle.edged = 0;
    client->handle.at_once--;
    into = outbox_push(client);
    to = open_message(into);
    put_array(&to, 4);
    put_int(&to, TAG_EDGES);
    put_int(&to, client->seat.session);
    put_stamp(&to, &sent);
    put_handle(client, &to);
    close_message(into, &to);
}

static void handle_acknowledged(handle *hand, int64_t edges) {
    const int64_t done = edges - hand->first;
    if (done <= 0 || done > hand->count) return;
    hand->first = edges;
    hand->count -= (int)done;
    memmove(hand->edge, hand->edge + done, sizeof hand->edge[0] * (size_t)hand->count);
    memmove(hand->tick, hand->tick + done, sizeof hand->tick[0] * (size_t)hand->count);
}

static double port_made_j(const line *now) { return now->made.value + now->made_now_j; }
static double port_j(const line *now) { return (now->made.value - now->used.value) + (now->made_now_j - now->used_now_j); }

static void write_waves(cogrip_client *client, message *into, int64_t now_ns) {
    const line *now = &client->line;
    const sender *up = &now->up;
    const int axes = client->axes, frames = sender_frames(up);
    const stamp sent = stamp_now(client, now_ns);
    writer to = open_message(into);
    put_array(&to, 17);
    put_int(&to, TAG_WAVES);
    put_int(&to, client->seat.session);
    put_int(&to, up->next - frames);
    put_array(&to, frames * axes);
    for (int64_t number = up->next - frames; number < up->next; number++)
        for (int axis = 0; axis < axes; axis++) put_real(&to, up->wave[number % up->redundancy][axis]);
    put_array(&to, axes);
    for (int axis = 0; axis < axes; axis++) put_real(&to, up->total[axis].value);
    put_array(&to, axes);
    for (int axis = 0; axis < axes; axis++) put_real(&to, up->squares[axis].value);
    put_real(&to, port_made_j(now));
    put_real(&to, port_j(now));
    put_int(&to, most_int(0, now->down.begun ? now->down.cursor : 0));
    put_stamp(&to, &sent);
    put_array(&to, 2 * axes);
    for (int axis = 0; axis < axes; axis++) put_real(&to, client->origin_m[axis]);
    for (int axis = 0; axis < axes; axis++) put_real(&to, client->position_m[axis]);
    put_int(&to, now->phase);
    put_int(&to, now->applied);
    put_real(&to, 0.0); /* b is the settings' one, always [5.8] */
    put_int(&to, 0);
    put_handle(client, &to);
    put_int(&to, 0);
    close_message(into, &to);
}

/* ---- Safety ---------------------------------------------------------------------------------- */

static void fail(cogrip_client *client, const char *why) {
    if (client->safety != COGRIP_LIVE && client->safety != COGRIP_STALE) return;
    client->safety = COGRIP_FAULT;
    client->counts[COGRIP_FAULTS]++;
    copy_text(client->why, sizeof client->why, why);
}

static void release(cogrip_client *client) {
    if (client->safety == COGRIP_RELEASED) return;
    client->safety = COGRIP_RELEASED;
    client->stopped = client->tick;
}

static int quiet(const cogrip_client *client) { return client->gain == 0.0 && size_of(client->force_n, AXES) == 0.0; }

/* Limit the force to `bound` around the last one. Returns 1 where it did. */
static int slew(const cogrip_client *client, double *wanted, double bound) {
    double change[AXES] = {0.0};
    for (int axis = 0; axis < client->axes; axis++) change[axis] = wanted[axis] - client->force_n[axis];
    const double size = size_of(change, client->axes);
    if (size <= bound) return 0;
    for (int axis = 0; axis < client->axes; axis++) wanted[axis] = client->force_n[axis] + bound / size * change[axis];
    return 1;
}

/* The gain of the next `limit`. */
static double coming_gain(const cogrip_client *client, int wished) {
    if (client->safety == COGRIP_LIVE && wished) return least(1.0, client->gain + client->tick_s / RAMP_IN_S);
    return most(0.0, client->gain - client->tick_s / (client->safety == COGRIP_FAULT ? FAULT_OUT_S : RAMP_OUT_S));
}

/* Turn the law's wish, NULL for none, into the force for the motors. Returns 1 where a limit held it. */
static int limit(cogrip_client *client, const double *wish, int gap, double *out) {
    const cogrip_config *config = &client->config;
    const double fall = client->safety == COGRIP_FAULT ? client->tick_s / FAULT_OUT_S : client->tick_s / RAMP_OUT_S;
    int limited = 0;
    client->gain = coming_gain(client, wish != NULL);
    if (wish) {
        const double size = size_of(wish, client->axes);
        const double scale = size > config->peak_force_n ? config->peak_force_n / size : 1.0;
        if (!(size < HUGE_VAL)) { /* nan, too */
            client->unstable = 1;
            fail(client, "the force law gave a number that is not finite; re-arm");
        } else {
            limited = scale < 1.0;
            client->counts[COGRIP_FORCE_CLIPPED] += (uint64_t)limited;
            client->at_limit = limited && client->gain == 1.0 ? client->at_limit + 1 : 0;
            if ((double)client->at_limit * client->tick_s > AT_LIMIT_S) {
                client->saturated = 1;
                fail(client, "the force sat at its limit for 0.5 s; press less or lower coupling.stiffness_npm, then re-arm");
            }
            for (int axis = 0; axis < client->axes; axis++) client->law_n[axis] = scale * wish[axis];
        }
    }
    for (int axis = 0; axis < client->axes; axis++) out[axis] = client->gain * client->law_n[axis];
    if (gap || client->soft_ticks) {
        const double soft =
            most(SOFT_SLOPE_NPS * client->tick_s, client->safety == COGRIP_FAULT ? fall * config->peak_force_n : 0.0);
        const int softened = slew(client, out, soft);
        client->soft_ticks = gap ? (int64_t)(SOFT_S / client->tick_s) : softened ? client->soft_ticks - 1 : 0;
    }
    if (slew(client, out, least(config->slew_nps, MOST_SLOPE_NPS) * client->tick_s)) {
        client->counts[COGRIP_SLEW_LIMITED]++;
        limited = 1;
    }
    return limited;
}

/* ---- Device port: the hand's work against what the line gave --------------------------------- */

static void port_enter(cogrip_client *client, double given_j) {
    const double taken_j = client->given_j - given_j;
    client->given_j = given_j;
    client->balance_j = client->work.value + given_j + client->own_j - client->cut_j;
    if (client->ramped && client->balance_j < 0.0 && taken_j > 0.0) { /* the hand does not feel all that moves the line */
        const double forgiven_j = least(taken_j, -client->balance_j);
        client->cut_j -= forgiven_j;
        client->forgiven_j += forgiven_j;
        client->balance_j += forgiven_j;
    }
    const double earned_j = client->balance_j - client->forgiven_j;
    client->least_j = least(client->least_j, earned_j);
    client->later_j = least(client->later_j, earned_j);
}

static double port_spare_j(const cogrip_client *client) {
    return client->free_j + client->balance_j - (client->ramped ? client->forgiven_j : 0.0);
}

static void port_end_frame(cogrip_client *client, int64_t ticks) {
    double moved[AXES] = {0.0};
    for (int axis = 0; axis < client->axes; axis++) moved[axis] = client->position_m[axis] - client->frame_start_m[axis];
    const double path_m = size_of(moved, client->axes);
    const double own_j = client->config.damping_nspm * path_m * path_m / ((double)ticks * client->tick_s);
    client->travel_m += path_m;
    client->own_j += own_j;
    client->balance_j += own_j;
    const double stored_j = client->effects.stored_j + client->gain * client->partners.stored_j;
    const double excess_j = client->balance_j - stored_j - client->reserve_j;
    if (excess_j > 0.0) {
        client->cut_j += excess_j;
        client->balance_j -= excess_j;
    }
    if (client->later_j == -HUGE_VAL && (double)(client->tick - client->first_tick) * client->tick_s >= 1.0)
        client->later_j = HUGE_VAL;
}

/* Shorten the law's force where the reserve is being used up. Returns 1 where it was. */
static int port_limit(const cogrip_client *client, double *force) {
    const double step_m = client->config.speed_mps * client->tick_s;
    const double left_j = most(0.0, client->balance_j + client->faded_j), size = size_of(force, client->axes);
    const double bound =
        most(left_j / (FADE_TICKS * step_m), 2.0 * sqrt(client->config.damping_nspm * left_j / client->tick_s));
    if (!(size > bound)) return 0;
    for (int axis = 0; axis < client->axes; axis++) force[axis] *= bound / size;
    return 1;
}

/* ---- Waves of ticks and frames --------------------------------------------------------------- */

static void line_init(cogrip_client *client, double most_credit) {
    const settings *seat = &client->seat.seat;
    line *now = &client->line;
    memset(now, 0, sizeof *now);
    now->up.axes = client->axes;
    now->up.redundancy = seat->redundancy;
    receiver_init(&now->down, seat, client->axes);
    now->down.energy.credit = least(now->down.energy.credit, most_credit);
    now->up_filter.lag_ticks = now->down_filter.lag_ticks =
        seat->wave_filter_hz > 0.0 ? 1.0 / (2.0 * 3.14159265358979323846 * seat->wave_filter_hz * client->tick_s) : 0.0;
    now->shifted = -1;
    now->reserve_j = -HUGE_VAL;
    memset(client->deflection_m, 0, sizeof client->deflection_m);
    client->deflected = client->cut = 0;
    client->ratio = 1.0;
}

static double line_lowpass(const cogrip_client *client) { return -expm1(-client->seat.seat.lowpass_rad_s * client->tick_s); }

static void line_elapse(cogrip_client *client, const double *mean, const double *velocity, double hold) {
    (void)mean;
    line *now = &client->line;
    double made = 0.0, used = 0.0, bent = 0.0;
    const double ratio = client->ratio;
    const int series = ratio != 1.0 || client->cut || client->deflected;
    now->ticks++;
    for (int axis = 0; axis < client->axes; axis++) {
        const double v = now->returning[axis];
        double y = velocity[axis];
        if (series) {
            double *z = &client->deflection_m[axis];
            y = ratio * (velocity[axis] + RELAX_RAD_S * *z) + (1.0 - ratio) * client->root / client->b * v;
            if (client->cut) y -= client->cut_n[axis] / client->b;
            *z = within(*z + (velocity[axis] - y) * client->tick_s, MOST_DEFLECTION_M);
            bent = most(bent, fabs(*z));
        }
        double u = client->root * y - v;
        if (hold != 1.0) u = hold * u + (1.0 - hold) * OPEN_FRACTION * v;
        if (client->seat.seat.decimator == DECIMATE_BOXCAR) now->decimated[axis] += u;
        else if (client->seat.seat.decimator == DECIMATE_NONE) now->decimated[axis] = u;
        else now->decimated[axis] += line_lowpass(client) * (u - now->decimated[axis]);
        made += u * u;
        used += v * v;
    }
    if (series) client->deflected = bent > LEAST_DEFLECTION_M;
    if (!client->deflected) memset(client->deflection_m, 0, sizeof client->deflection_m);
    now->made_now_j += made * 0.5 * client->tick_s;
    now->used_now_j += used * 0.5 * client->tick_s;
}

/* Enter a tick without a hand: send 0, absorb what comes. */
static void line_elapse_absent(cogrip_client *client) {
    line *now = &client->line;
    const double size = size_of(now->returning, client->axes);
    now->ticks++;
    memset(client->deflection_m, 0, sizeof client->deflection_m);
    client->deflected = 0;
    if (client->seat.seat.decimator == DECIMATE_NONE) memset(now->decimated, 0, sizeof now->decimated);
    if (client->seat.seat.decimator == DECIMATE_LOWPASS)
        for (int axis = 0; axis < client->axes; axis++)
            now->decimated[axis] *= 1.0 - line_lowpass(client);
    now->used_now_j += size * size * 0.5 * client->tick_s;
}

/* Ticks of the next frame: M, or as many more or fewer as shift the phase by what the server has to spare [5.7]. */
static int64_t line_next_length(line *now, int64_t ticks) {
    int64_t spare = now->spare;
    now->shift = 0;
    if (spare > 0) spare--; /* jitter soon takes a single tick back */
    now->asked = (now->asked > 0) == (spare > 0) && now->asked && spare ? now->asked + spare : spare;
    if (now->shifted < 0) {
        if (now->spare && now->acknowledged) now->shift = most_int(-1, least_int(ticks - 1, now->spare));
    } else if (now->acknowledged > now->shifted && (now->asked < -PHASE_PRESSING || now->asked > PHASE_QUIET)) {
        now->shift = spare > 0 ? 1 : -1;
    }
    if (now->shift + ticks < 1) now->shift = 0;
    if (now->shift) {
        now->shifted = now->up.next;
        now->asked = 0;
    }
    return ticks + now->shift;
}

/* End a frame, of at most `spare_j` more energy than it brought. Returns the ticks of the next one. */
static int64_t line_end_frame(cogrip_client *client, double spare_j) {
    line *now = &client->line;
    const int axes = client->axes, ticks = client->ticks_per_frame;
    const double half_frame_s = 0.5 * client->tick_s * ticks;
    double mean[AXES] = {0.0}, sent[AXES] = {0.0}, held = size_of(now->withheld, axes);
    now->phase += now->shift;
    for (int axis = 0; axis < axes; axis++) {
        mean[axis] = now->decimated[axis];
        if (client->seat.seat.decimator == DECIMATE_BOXCAR) {
            mean[axis] *= 1.0 / ticks;
            now->decimated[axis] = 0.0;
        }
    }
    filter_step(&now->up_filter, mean, axes, ticks);
    for (int axis = 0; axis < axes; axis++) sent[axis] = mean[axis] + WITHHELD_FRACTION * now->withheld[axis];
    const double brought = now->used_now_j, bound = most(0.0, spare_j + brought);
    double going = 0.0;
    for (int axis = 0; axis < axes; axis++) going += half_frame_s * (sent[axis] * sent[axis]);
    const int scaled = going > bound;
    if (scaled) {
        const double scale = sqrt(bound / going);
        for (int axis = 0; axis < axes; axis++) sent[axis] *= scale;
        going *= scale * scale;
    }
    if (scaled || held != 0.0)
        for (int axis = 0; axis < axes; axis++) now->withheld[axis] += mean[axis] - sent[axis];
    if (scaled || held != 0.0 || now->shift > 0) now->made_now_j = most(now->made_now_j, going);
    add(&now->given, brought - going);
    sender_push(&now->up, sent);
    add(&now->made, now->made_now_j);
    add(&now->used, now->used_now_j);
    now->made_now_j = now->used_now_j = 0.0;
    now->applied = now->ticks - now->began;
    return line_next_length(now, ticks);
}

/* What plays from this tick on is held for so many ticks. */
static void play_for(cogrip_client *client, int64_t tick, int64_t ticks) {
    const int64_t late = ticks == client->ticks_per_frame ? (tick - client->wave_end) % ticks : 0;
    client->wave_end = tick + ticks - late;
}

/* Play the returning wave of the next frame, from this tick on. */
static void line_start_frame(cogrip_client *client, int64_t tick) {
    line *now = &client->line;
    receiver *down = &now->down;
    const int64_t ticks_per_frame = client->ticks_per_frame;
    receiver_pop(down, now->returning);
    if (++now->popped >= client->seat.seat.network_hz && now->reserve_j == -HUGE_VAL) now->reserve_j = HUGE_VAL;
    if (down->told) {
        const double rounding = (2.0 * (double)ticks_per_frame + 32.0) * ROUNDOFF;
        const double margin_j = down->made_j - down->played_j.value + rounding * down->made_j;
        client->down_margin_j = least(client->down_margin_j, margin_j);
        now->reserve_j = least(now->reserve_j, margin_j);
    }
    for (int axis = 0; axis < client->axes; axis++) {
        if (fabs(now->returning[axis]) <= client->most_wave) continue;
        now->returning[axis] = within(now->returning[axis], client->most_wave);
        client->counts[COGRIP_IMPLAUSIBLE_WAVE]++;
    }
    filter_step(&now->down_filter, now->returning, client->axes, down->hold);
    now->began = now->ticks;
    play_for(client, tick, down->hold);
}

/* F = b xdot - sqrt(2b) v (docs/theory.md, 1), through the series impedance where the device carries less than b. */
static void line_law(cogrip_client *client, double *force) {
    const double carried = client->config.carried_nspm;
    client->ratio = carried < client->b ? carried / client->b : 1.0;
    for (int axis = 0; axis < client->axes; axis++) {
        const double speed = client->velocity_mps[axis] + (client->deflected ? RELAX_RAD_S * client->deflection_m[axis] : 0.0);
        force[axis] = client->ratio * (client->b * speed - client->root * client->line.returning[axis]);
    }
}

static void line_count(const cogrip_client *client, cogrip_link_count *into) { receiver_count(&client->line.down, into); }
static double line_damper(const settings *seat) { return seat->impedance_nspm; }

/* ---- Ticks and frames with partners' models [7e] ---------------------------------------------- */

static double partners_damper(const settings *seat) { return seat->damping_nspm; }

static void partners_count(const cogrip_client *client, cogrip_link_count *into) { latest_count(&client->partners.down, into); }

/* Begin a line. Gate, copy and models of a hand that was here before go on: it has one budget for its life. */
static void partners_begin(cogrip_client *client, double most_credit) {
    partners *all = &client->partners;
    line_init(client, most_credit); /* of it this scheme uses the sums of energy, and the number of a frame */
    if (all->gate.tick_s == 0.0) gate_init(&all->gate, client->tick_s);
    all->worked_j = all->gate.work.value;
    all->granted_j = gate_granted_j(&all->gate);
    all->hold = 1.0;
    all->clock_ns = 0;
    all->others = (int)most_int(1, client->seat.seat.people - 1);
    for (int place = 0; place < all->count; place++) { /* whatever counters and clock the server has now */
        all->known[place].counted = 0;
        all->known[place].told.made_ns = 0;
    }
    latest_init(&all->down);
}

static void partners_elapse(cogrip_client *client, const double *mean, const double *goes_on, double hold) {
    partners *all = &client->partners;
    (void)goes_on;
    add(&all->gate.work, dot(all->applied_n, mean, client->axes) * client->tick_s);
    client->line.made.value = all->gate.work.value - all->worked_j;
    all->elapsed++;
    all->hold = hold;
}

/* Enter a tick without a hand: its partners are told that it lets go, and the copy begins anew with the next one. */
static void partners_elapse_absent(cogrip_client *client) {
    client->partners.held = 0;
    client->partners.here_s = 0.0;
    client->partners.elapsed = 0;
}

static int64_t partners_end_frame(cogrip_client *client, double spare_j) {
    line *now = &client->line;
    const double reserve_j = gate_reserve_j(&client->partners.gate);
    (void)spare_j;
    now->up.next++;
    client->down_margin_j = least(client->down_margin_j, reserve_j);
    if (++now->popped >= client->seat.seat.network_hz && now->reserve_j == -HUGE_VAL) now->reserve_j = HUGE_VAL;
    now->reserve_j = least(now->reserve_j, reserve_j);
    return client->ticks_per_frame;
}

static void partner_begin(partner *one, const double *position_m, int axes) {
    one->share = 0.0;
    one->stiffness_npm = 0.0;
    for (int axis = 0; axis < axes; axis++) {
        one->place_m[axis] = one->intention_m[axis] = position_m[axis];
        one->velocity_mps[axis] = one->drift_mps[axis] = 0.0;
    }
}

/* The partner of a seat; of one that is new, in the place of the one that has been silent longest. */
static partner *partner_of(partners *all, const intent *told) {
    int longest = 0;
    for (int place = 0; place < all->count; place++) {
        if (all->known[place].told.seat == told->seat) return &all->known[place];
        if (all->known[place].silent_s > all->known[longest].silent_s) longest = place;
    }
    partner *one = &all->known[all->count < MOST_PARTNERS ? all->count++ : longest];
    memset(one, 0, sizeof *one);
    one->told.seat = told->seat;
    partner_begin(one, all->held ? all->place_m : told->place_m, told->axes); /* where it pulls at nothing */
    return one;
}

static void partner_take(partners *all, const intent *told) {
    partner *one = partner_of(all, told);
    if (one->told.axes && told->made_ns > 0 && one->told.made_ns >= told->made_ns) return;
    const int64_t age_ns = told->made_ns && all->clock_ns ? most_int(0, all->clock_ns - told->made_ns) : 0;
    one->told = *told;
    one->silent_s = 0.0;
    one->age_s = 1e-9 * (double)age_ns;
    if (one->counted) all->gate.coming_j += most(0.0, told->donated_j - one->donated_j) / all->others;
    one->counted = 1;
    one->donated_j = told->donated_j; /* where it is smaller than before, it counts anew */
}

static void partners_start_frame(cogrip_client *client, int64_t tick) {
    partners *all = &client->partners;
    const double frame_s = client->tick_s * client->ticks_per_frame;
    for (int place = 0; place < all->count; place++) all->known[place].silent_s += frame_s;
    if (latest_pop(&all->down)) {
        const told_partners *told = &all->down.next;
        memcpy(client->object, told->position_m, sizeof client->object[0] * (size_t)client->axes);
        memcpy(client->object + client->axes, told->velocity_mps, sizeof client->object[0] * (size_t)client->axes);
        for (int place = 0; place < told->count; place++) partner_take(all, &told->intents[place]);
    }
    for (int place = 0; place < all->count; place++) {
        partner *one = &all->known[place];
        for (int axis = 0; axis < client->axes; axis++) {
            const double rate_mps = one->silent_s <= HORIZON_S ? one->told.rate_mps[axis] : 0.0;
            one->drift_mps[axis] += least(1.0, frame_s / DRIFT_S) * (rate_mps - one->drift_mps[axis]);
        }
    }
    play_for(client, tick, client->ticks_per_frame);
}

/* Step copy and models by a tick. */
static void partners_step(cogrip_client *client, double K, double B) {
    partners *all = &client->partners;
    const settings *seat = &client->seat.seat;
    all->here_s += client->tick_s;
    for (int place = 0; place < all->count; place++) {
        partner *one = &all->known[place];
        one->age_s += client->tick_s;
        const double left = most(0.0, 1.0 - most(0.0, one->silent_s - SILENT_S) / SILENT_S);
        const double reach_s = least(most(0.0, one->age_s), HORIZON_S);
        one->share = least(left, one->share + client->tick_s / GROW_S);
        one->stiffness_npm = one->told.stiffness_npm * one->share;
        for (int axis = 0; axis < client->axes; axis++)
            one->intention_m[axis] = one->told.place_m[axis] + reach_s * one->told.rate_mps[axis];
    }
    for (int axis = 0; axis < client->axes; axis++) {
        const double own[2] = {client->position_m[axis], client->velocity_mps[axis]};
        step_copy(axis, client->tick_s, &all->place_m[axis], &all->velocity_mps[axis], seat->mass_kg, seat->object_nspm, K, B,
            all->known, all->count, own);
    }
}

/* F = K s + B (x' - o'), gated (docs/theory.md 5b). */
static void partners_law(cogrip_client *client, double *force) {
    partners *all = &client->partners;
    const int axes = client->axes;
    const double B = least(client->seat.seat.damping_nspm, client->carried_nspm);
    const double K = least(client->seat.seat.stiffness_npm, client->carried_nspm / client->lag_s);
    double stretch[AXES] = {0.0};
    if (!all->held) { /* begin with the object in the hand, at rest, its spring unstretched */
        all->held = 1;
        memcpy(all->place_m, client->position_m, sizeof all->place_m);
        memset(all->velocity_mps, 0, sizeof all->velocity_mps);
        intention_begin(&all->own, client->position_m, axes);
        for (int place = 0; place < all->count; place++) partner_begin(&all->known[place], client->position_m, axes);
    }
    const int64_t ticks = least_int(MOST_COPY_TICKS, most_int(1, all->elapsed));
    all->elapsed = 0;
    intention_update(&all->own, client->position_m, client->velocity_mps, all->applied_n, client->config.apparent_mass_kg,
        client->tick_s, axes);
    for (int64_t tick = 0; tick < ticks; tick++) partners_step(client, K, B);
    for (int axis = 0; axis < axes; axis++) stretch[axis] = client->position_m[axis] - all->place_m[axis];
    const double part = gate_cut(&all->gate, stretch, axes, K);
    for (int axis = 0; axis < axes && part < 1.0; axis++) { /* the copy moves to where it may be, no faster than that */
        const double before = all->place_m[axis], kept = all->velocity_mps[axis];
        stretch[axis] *= part;
        all->place_m[axis] = client->position_m[axis] - stretch[axis];
        const double moved = kept + (all->place_m[axis] - before) / ((double)ticks * client->tick_s);
        if (moved * kept < 0.0) all->velocity_mps[axis] = 0.0;
        else if (fabs(moved) < fabs(kept)) all->velocity_mps[axis] = moved;
    }
    for (int axis = 0; axis < axes; axis++) force[axis] = B * (client->velocity_mps[axis] - all->velocity_mps[axis]);
    gate_pay(&all->gate, stretch, K, force, client->velocity_mps, B, axes);
    for (int axis = 0; axis < axes; axis++) force[axis] += K * stretch[axis];
    all->stored_j = 0.5 * K * dot(stretch, stretch, axes);
    client->line.given.value = gate_granted_j(&all->gate) - all->granted_j;
}

static void put_intent(writer *to, const intent *from) {
    put_array(to, 6);
    put_int(to, from->seat);
    put_int(to, from->made_ns);
    put_row(to, from->place_m, from->axes);
    put_row(to, from->rate_mps, from->rates);
    put_real(to, from->stiffness_npm);
    put_real(to, from->donated_j);
}

static void write_partners(cogrip_client *client, message *into, int64_t now_ns) {
    partners *all = &client->partners;
    const clock_offset *clock = &client->clock;
    const stamp sent = stamp_now(client, now_ns);
    const int axes = client->axes;
    writer to = open_message(into);
    all->clock_ns = clock->known ? now_ns + clock->low_ns + (clock->high_ns - clock->low_ns) / 2 : 0;
    put_array(&to, 11);
    put_int(&to, TAG_PARTNER);
    put_int(&to, client->seat.session);
    put_int(&to, most_int(0, client->line.up.next - 1));
    put_row(&to, client->position_m, axes);
    put_row(&to, client->velocity_mps, axes);
    put_array(&to, all->held);
    if (all->held) {
        intent own;
        memset(&own, 0, sizeof own);
        own.seat = client->seat.seat.seat;
        own.made_ns = most_int(0, all->clock_ns);
        own.axes = own.rates = axes;
        memcpy(own.place_m, all->own.place_m, sizeof all->own.place_m);
        memcpy(own.rate_mps, all->own.rate_mps, sizeof all->own.rate_mps);
        own.stiffness_npm = HAND_NPM * all->hold * least(1.0, all->here_s / GROW_S);
        own.donated_j = all->gate.donated_j;
        put_intent(&to, &own);
    }
    put_int(&to, all->down.last_number + 1);
    put_stamp(&to, &sent);
    put_handle(client, &to);
    put_int(&to, 0);
    put_real(&to, gate_reserve_j(&all->gate));
    close_message(into, &to);
}

/* The schemes that this client has. */
static const coupling couplings[] = {
    {"wave", TAG_WAVES, line_damper, line_init, line_elapse, line_elapse_absent, line_end_frame, line_start_frame, line_law,
        write_waves, line_count},
    {"partner", TAG_PARTNER, partners_damper, partners_begin, partners_elapse, partners_elapse_absent, partners_end_frame,
        partners_start_frame, partners_law, write_partners, partners_count}};
enum { COUPLINGS = sizeof couplings / sizeof couplings[0] };

static const coupling *coupling_of(const char *kind) {
    for (int place = 0; place < COUPLINGS; place++)
        if (!strcmp(couplings[place].kind, kind)) return &couplings[place];
    return NULL;
}

/* ---- Session [4] ----------------------------------------------------------------------------- */

/* Read a stamp: round trip, and offset of the clocks. */
static void read_stamp(cogrip_client *client, const stamp *from, int64_t now_ns) {
    clock_offset *clock = &client->clock;
    if (from->sent_ns > clock->peer_sent_ns) {
        clock->peer_sent_ns = from->sent_ns;
        clock->received_ns = now_ns;
    }
    if (!from->echo_ns) return;
    if (from->echo_ns > now_ns || from->held_ns > now_ns - from->echo_ns
        || now_ns - from->echo_ns - from->held_ns >= MOST_RTT_NS ||
        from->sent_ns > INT64_MAX - 2 * MOST_RTT_NS) {
        client->counts[COGRIP_IMPLAUSIBLE_STAMP]++;
        return;
    }
    const int64_t rtt_ns = now_ns - from->echo_ns - from->held_ns, low_ns = from->sent_ns - now_ns, high_ns = low_ns + rtt_ns;
    int64_t least_ns = low_ns, most_ns = high_ns;
    if (clock->known) {
        const int64_t way_ns = (now_ns - clock->read_ns) / DRIFT_PART + 1;
        least_ns = most_int(least_ns, clock->low_ns - way_ns);
        most_ns = least_int(most_ns, clock->high_ns + way_ns);
        if (least_ns > most_ns) { /* they contradict each other: a clock was set */
            least_ns = low_ns;
            most_ns = high_ns;
        }
    }
    clock->known = 1;
    clock->low_ns = least_ns;
    clock->high_ns = most_ns;
    clock->read_ns = now_ns;
    const int64_t offset_ns = least_ns + (most_ns - least_ns) / 2;
    delays_add(&client->rtt, rtt_ns);
    delays_add(&client->down_ms, offset_ns - low_ns);
    if (from->echo_ns > clock->echoed_ns) {
        clock->echoed_ns = from->echo_ns;
        delays_add(&client->up_ms, high_ns - offset_ns);
    }
}

static void add_counts(cogrip_link_count *into, const cogrip_link_count *from) {
    into->sent += from->sent;
    into->received += from->received;
    into->applied += from->applied;
    into->lost += from->lost;
    into->late += from->late;
    into->duplicate += from->duplicate;
    into->pending += from->pending;
}

static cogrip_link_count down_count(const cogrip_client *client) {
    cogrip_link_count count;
    client->scheme->count(client, &count);
    add_counts(&count, &client->closed_down);
    return count;
}

static double known(double value) { return value > -HUGE_VAL && value < HUGE_VAL ? value : NAN; }

static void make_account(const cogrip_client *client, account *into) {
    const line *now = &client->line;
    const jitter_buffer *buffer = &now->down.buffer;
    const double ticks = (double)most_int(1, client->forced_ticks), filter_hz = client->seat.seat.wave_filter_hz;
    const double line_values[6] = {client->b, client->b, client->b, filter_hz, filter_hz, filter_hz};
    memset(into, 0, sizeof *into);
    into->axes = client->axes;
    into->waveless = client->scheme->tag != TAG_WAVES;
    memcpy(into->position_m, client->position_m, sizeof client->position_m);
    memcpy(into->force_n, client->force_n, sizeof client->force_n);
    into->peak_force_n = client->peak_force_n;
    into->peak_step_n = client->peak_step_n;
    into->travel_m = client->travel_m;
    into->felt_npm = into->predicted_npm = NAN;
    into->down_margin_j = client->down_margin_j;
    into->down_reserve_j = known(least(client->down_reserve_j, now->reserve_j > -HUGE_VAL ? now->reserve_j : HUGE_VAL));
    into->leak_j = client->least_leak_j;
    into->down = down_count(client);
    delays_percentiles(&client->rtt, into->rtt_ms);
    delays_percentiles(&client->up_ms, into->up_ms);
    delays_percentiles(&client->down_ms, into->down_ms);
    for (int place = 0; place < 4; place++) into->late_us[place] = into->work_us[place] = NAN;
    into->offset_ms = client->clock.known
        ? (double)(client->clock.low_ns + (client->clock.high_ns - client->clock.low_ns) / 2) * 1e-6 : NAN;
    into->uncertainty_ms = client->clock.known ? (double)(client->clock.high_ns - client->clock.low_ns + 1) * 0.5e-6 : NAN;
    into->ticks_due = client->tick < 0 ? 0 : client->tick - client->first_tick + 1;
    into->ticks_run = client->ticks_run;
    into->unstable = client->unstable;
    into->incidents = client->saturated ? 2 : 0; /* the hand's workspace is not known here */
    copy_text(into->state, sizeof into->state, safety_names[client->safety]);
    copy_text(into->reason, sizeof into->reason, client->failed[0] ? client->failed : client->why);
    into->depth_frames = buffer->automatic ? (double)buffer->depth_sum / (double)most_int(1, buffer->borders) / buffer->ticks
        : buffer->frames;
    into->least_frames = buffer->automatic ? (double)least_int(buffer->shallowest, buffer->deepest) / buffer->ticks
        : buffer->frames;
    into->most_frames = buffer->automatic ? (double)buffer->deepest / buffer->ticks : buffer->frames;
    into->repeated = buffer->repeated;
    into->skipped = buffer->skipped;
    into->concealed = now->down.concealed;
    into->longest_gap = now->down.longest_gap;
    into->at_limit = (double)client->limited_ticks / ticks;
    into->controlled = (double)client->controlled_ticks / ticks;
    into->port_leak_j = most(0.0, -client->least_j);
    into->port_margin_j = client->least_j + client->reserve_j;
    into->port_budget_j = client->reserve_j;
    into->port_shake_n = NAN; /* it is not measured here */
    into->port_reserve_j = known(client->later_j + client->reserve_j);
    memcpy(into->line, line_values, sizeof line_values);
    into->has_effects = client->effects.told;
    into->least_tank_j = client->effects.least_level_j - client->effects.overdrawn_j;
    into->drawn_j = client->effects.drawn_j;
    into->reduced_s = (double)client->effects.less_ticks * client->tick_s;
}

static void send_leave(cogrip_client *client, const char *reason) {
    account report;
    make_account(client, &report);
    write_leave(&client->leaving, client->seat.session, reason, client->tick < 0 ? NULL : &report);
}

/* A text from the network as a person may see it. */
static void show(char *into, size_t size, const char *text) {
    copy_text(into, size, text);
    for (char *at = into; *at; at++)
        if ((unsigned char)*at < 0x20 || *at == 0x7f) *at = '?';
}

static void close_session(cogrip_client *client, const char *why) {
    client->state = COGRIP_CLOSED;
    if (!client->failed[0]) copy_text(client->failed, sizeof client->failed, why);
}

/* Why a person cannot take this seat with this client; NULL: they can. */
static const char *unsupported(cogrip_client *client, const welcome *given) {
    const settings *seat = &given->seat;
    char kind[KIND_BYTES];
    if (!given->player) return "the token is for observing: this client only plays; ask for a player's link";
    if (client->seat.session && seat->print != client->seat.seat.print)
        return "the server came back with another seat or other settings: join anew";
    if (!coupling_of(seat->kind)) {
        show(kind, sizeof kind, seat->kind);
        snprintf(client->unknown, sizeof client->unknown, "the seat's coupling.kind is \"%s\", which this client has not: take",
            kind);
        for (int place = 0; place < COUPLINGS; place++) {
            const size_t used = strlen(client->unknown);
            snprintf(client->unknown + used, sizeof client->unknown - used, "%s \"%s\"", place ? " or" : "",
                couplings[place].kind);
        }
        return client->unknown;
    }
    if (seat->scene && !strcmp(seat->kind, "partner"))
        return "the room is a scene with models of partners, of which this client makes no copy: set coupling.kind = \"wave\"";
    if (seat->grips) return "the seat's tool is a gripper, which this client has none of: take another seat";
    if (seat->axes > AXES)
        return "the room has 6 axes, this client 3: set orientation = \"free\", \"damped\" or \"fixed\" for this seat";
    if (seat->axes > client->config.axes) return "the room has more axes than the device: set object.axes lower";
    if (seat->device_hz < LEAST_DEVICE_HZ)
        return "rates.device_hz is below 250 Hz, the least that is safe for a hand: raise it in the server's settings";
    if (seat->device_hz > client->config.rate_hz)
        return "rates.device_hz is above what the device allows: lower it for this seat";
    if (seat->scaled)
        return "the settings scale, turn or clutch this hand, which this client cannot: take position_scale, force_scale and "
               "rotation out of its [[users]]";
    if (seat->aided)
        return "the settings limit this hand's workspace, or carry its handle, which this client cannot: take "
               "workspace_limit_m and gravity_compensation out of its [[users]]";
    if (seat->emulated)
        return "the settings ask for an emulated network, which this client has not: take [link] out of the server's settings";
    if (seat->redundancy * seat->axes > MOST_WAVES)
        return "playout.redundancy is too large for the axes of this room: lower it";
    return NULL;
}

/* Memory of the velocity's estimator in this loop. */
static double estimator_memory(const cogrip_client *client) {
    return client->tick_s >= MEMORY_TICK_S ? MEMORY : 1.0 - (1.0 - MEMORY) * sqrt(client->tick_s / MEMORY_TICK_S);
}

static void begin_seat(cogrip_client *client) {
    const settings *seat = &client->seat.seat;
    const cogrip_config *config = &client->config;
    client->scheme = coupling_of(seat->kind);
    client->axes = seat->axes;
    client->ticks_per_frame = seat->device_hz / seat->network_hz;
    client->tick_s = 1.0 / seat->device_hz;
    client->b = seat->impedance_nspm;
    client->root = sqrt(2.0 * client->b);
    client->most_wave = (client->b * config->speed_mps + 2.0 * config->peak_force_n) / client->root;
    const double tick_j = config->peak_force_n * config->speed_mps * client->tick_s;
    const double falling_j =
        0.5 * config->peak_force_n * config->peak_force_n * config->speed_mps / least(config->slew_nps, SOFT_SLOPE_NPS);
    client->free_j = 0.5 * config->apparent_mass_kg * FREE_RESERVE_MPS * FREE_RESERVE_MPS;
    client->faded_j = client->free_j + FADE_TICKS * tick_j;
    client->reserve_j = client->faded_j + most(tick_j, falling_j);
    client->safety = COGRIP_LIVE;
    const double memory = estimator_memory(client);
    client->lag_s = (1.0 + memory) / (1.0 - memory) * client->tick_s;
    client->carried_nspm = least(config->carried_nspm, config->apparent_mass_kg / client->lag_s);
    client->damper_nspm = client->scheme->damper_nspm(seat);
    effects_fit(&client->effects, client->axes, client->tick_s, client->carried_nspm, client->lag_s, client->damper_nspm,
        config->speed_mps, config->slew_nps, TOLERATED_FRACTION * client->free_j);
    client->scheme->begin(client, HUGE_VAL);
}

/* Begin a new line, where the hand is now: the server was started anew, or had given the seat up [4.4]. */
static void renew_line(cogrip_client *client) {
    line *now = &client->line;
    cogrip_link_count count;
    double left = HUGE_VAL;
    for (int axis = 0; axis < client->axes; axis++) left = least(left, ledger_allowance(&now->down.energy, axis));
    client->scheme->count(client, &count);
    count.pending = 0;
    add_counts(&client->closed_down, &count);
    client->closed_given_j += now->given.value - (now->made_now_j - now->used_now_j);
    client->closed_port_j += port_j(now);
    if (now->reserve_j > -HUGE_VAL) client->down_reserve_j = least(client->down_reserve_j, now->reserve_j);
    effects_forget(&client->effects);
    client->scheme->begin(client, most(0.0, left)); /* all lines together lend one credit [5.4] */
    memset(&client->clock, 0, sizeof client->clock);
    client->handle.first = client->handle.count = 0;
    client->handle.said = 0;
    memcpy(client->origin_m, client->position_m, sizeof client->origin_m);
    if (client->tick < 0) return;
    if (client->acted == client->tick || client->tick < client->wave_end)
        client->scheme->start_frame(client, client->tick);
    client->frame_end = client->frame_begin + client->ticks_per_frame;
    for (int64_t tick = client->frame_begin; tick < client->tick; tick++) client->scheme->elapse_absent(client);
}

static void take_welcome(cogrip_client *client, const welcome *given, int64_t now_ns) {
    const char *fault;
    if (given->nonce != (int64_t)client->config.nonce) {
        client->counts[COGRIP_OTHER_NONCE]++;
        return;
    }
    if (client->state != COGRIP_CONNECTING && client->state != COGRIP_RESUMING) return;
    if ((fault = unsupported(client, given))) {
        write_leave(outbox_push(client), given->session, fault, NULL);
        close_session(client, fault);
        return;
    }
    const int first = client->seat.session == 0, renewed = !first && given->session != client->seat.session;
    client->counts[COGRIP_RENEWED] += (uint64_t)renewed;
    client->counts[COGRIP_RESUMED] += (uint64_t)(!first && !renewed);
    memcpy(&client->seat, given, sizeof client->seat);
    client->state = COGRIP_SEATED;
    client->last_received_ns = client->next_ns = now_ns;
    if (first || renewed) {
        client->begun = 0;
        client->fresh_ns = now_ns;
    }
    if (first) begin_seat(client);
    if (renewed) renew_line(client);
}

static void take_refusal(cogrip_client *client, const refusal *given) {
    char reason[COGRIP_TEXT_BYTES], code[161], text[sizeof client->failed];
    if (given->nonce != (int64_t)client->config.nonce) {
        client->counts[COGRIP_OTHER_NONCE]++;
    } else if (client->state == COGRIP_CONNECTING || client->state == COGRIP_RESUMING) {
        show(reason, sizeof reason, given->reason);
        show(code, sizeof code, given->code);
        snprintf(text, sizeof text, "the server refused: %s [%s]", reason, code);
        close_session(client, text);
    }
}

static void take_waves(cogrip_client *client, const waves *given, int64_t now_ns) {
    line *now = &client->line;
    if (client->tick < 0) { /* the device is still being opened: what comes now must not set the jitter buffer */
        client->counts[COGRIP_EARLY]++;
        return;
    }
    read_stamp(client, &given->sent, now_ns);
    /* Ticks to the next pop, from the tick that has this: the one under way, or where its force was given the next one. */
    const int64_t before = now->down.newest,
        early = most_int(0, client->wave_end - client->tick - (client->acted == client->tick));
    const int fits = given->states == 2 * client->axes && (given->impedance_nspm == 0.0 || given->impedance_nspm == client->b);
    if (!fits || !receiver_take(&now->down, given, early)) {
        client->counts[COGRIP_UNFIT]++;
        return;
    }
    memcpy(client->object, given->state, sizeof client->object[0] * 2 * (size_t)client->axes);
    now->spare = given->phase;
    now->acknowledged = given->acknowledged;
    handle_acknowledged(&client->handle, given->edges);
    if (now->down.newest > before) {
        client->begun = 1;
        client->fresh_ns = now_ns;
    }
}

static void take_partners(cogrip_client *client, const told_partners *told, int64_t now_ns) {
    latest *down = &client->partners.down;
    if (client->tick < 0) {
        client->counts[COGRIP_EARLY]++;
        return;
    }
    read_stamp(client, &told->sent, now_ns);
    const int64_t before = down->newest;
    if (!partners_of_axes(told, client->axes) || !latest_take(down, told)) {
        client->counts[COGRIP_UNFIT]++;
        return;
    }
    client->line.acknowledged = most_int(client->line.acknowledged, told->acknowledged);
    handle_acknowledged(&client->handle, told->edges);
    if (down->newest > before) {
        client->begun = 1;
        client->fresh_ns = now_ns;
    }
}

static void take_farewell(cogrip_client *client, const farewell *given) {
    char reason[COGRIP_TEXT_BYTES], text[sizeof client->failed];
    const cogrip_state before = client->state;
    if (before != COGRIP_SEATED && before != COGRIP_RESUMING && before != COGRIP_LEAVING) return;
    client->goodbye = *given;
    show(reason, sizeof reason, given->reason);
    snprintf(text, sizeof text, "the server said goodbye: %s", reason);
    close_session(client, before == COGRIP_LEAVING ? "" : text);
    if (before == COGRIP_LEAVING) return;
    send_leave(client, "the server stopped");
    memcpy(outbox_push(client), &client->leaving, sizeof client->leaving);
}

static void take_effects(cogrip_client *client, const told_effects *told) {
    const int dropped = effects_tell(&client->effects, told, client->tick);
    if (dropped >= 0) client->counts[dropped]++;
    write_effects(client, outbox_push(client), told);
}

/* True for a message of this session; then its time is noted. */
static int of_session(cogrip_client *client, int64_t session, int64_t now_ns) {
    if (!client->seat.session || client->state == COGRIP_CLOSED) {
        client->counts[COGRIP_UNEXPECTED]++;
        return 0;
    }
    if (session != client->seat.session) {
        client->counts[COGRIP_OTHER_SESSION]++;
        return 0;
    }
    if (client->state == COGRIP_RESUMING) {
        client->state = COGRIP_SEATED;
        client->counts[COGRIP_RESUMED]++;
    }
    client->last_received_ns = now_ns;
    return 1;
}

/* Everything a client can be sent, decoded. */
typedef struct decoded {
    int tag; /* 0: malformed; of others than these, the rest is empty */
    union {
        struct welcome welcome;
        struct refusal refusal;
        struct redirect redirect;
        struct waves waves;
        told_partners partners;
        struct farewell farewell;
        told_effects effects;
        struct {
            int64_t session;
            stamp sent;
        } heartbeat;
        struct {
            int64_t session, number;
        } hand;
    } as;
} decoded;

static void decode(const void *data, size_t bytes, decoded *into) {
    reader from = {(const unsigned char *)data, (const unsigned char *)data + bytes, 0};
    if (!bytes) from.bad = 1;
    const uint64_t length = get_length(&from, 0, 1, UINT32_MAX);
    into->tag = (int)get_int(&from, TAG_HELLO, TAG_PARTNER);
    switch (into->tag) {
    case TAG_WELCOME: get_welcome(&from, length, &into->as.welcome); break;
    case TAG_REFUSE: get_refusal(&from, length, &into->as.refusal); break;
    case TAG_REDIRECT: get_redirect(&from, length, &into->as.redirect); break;
    case TAG_WAVES: get_waves(&from, length, &into->as.waves); break;
    case TAG_PARTNER: get_partners(&from, length, &into->as.partners); break;
    case TAG_FAREWELL: get_farewell(&from, length, &into->as.farewell); break;
    case TAG_EFFECTS: get_effects(&from, length, &into->as.effects); break;
    case TAG_RESTART: /* the server will be silent, and this client resumes by silence [4.6] */
        if (length != 3) from.bad = 1;
        get_int(&from, 1, INT64_MAX);
        get_int(&from, 0, MOST_WAIT_MS);
        break;
    case TAG_HEARTBEAT:
        if (length != 3) from.bad = 1;
        into->as.heartbeat.session = get_int(&from, 1, INT64_MAX);
        get_stamp(&from, &into->as.heartbeat.sent);
        break;
    case TAG_SET_HAND:
        if (length != 4 && length != 5) from.bad = 1;
        into->as.hand.session = get_int(&from, 1, INT64_MAX);
        into->as.hand.number = get_int(&from, 0, MOST_INT);
        get_int(&from, 0, MOST_INT);
        if (length == 5) skip(&from);
        break;
    default: close_array(&from, length, 1); /* not for a player of these schemes */
    }
    if (from.bad || from.at != from.end) into->tag = 0;
}

void cogrip_receive(cogrip_client *client, const void *data, size_t bytes, int64_t now_ns) {
    decoded found;
    if (bytes > COGRIP_MESSAGE_BYTES) {
        client->counts[COGRIP_TOO_LARGE]++;
        return;
    }
    decode(data, bytes, &found);
    switch (found.tag) {
    case 0: client->counts[COGRIP_MALFORMED]++; break;
    case TAG_WELCOME: take_welcome(client, &found.as.welcome, now_ns); break;
    case TAG_REFUSE: take_refusal(client, &found.as.refusal); break;
    case TAG_WAVES:
        if (!of_session(client, found.as.waves.session, now_ns)) break;
        if (client->scheme->tag == TAG_WAVES) take_waves(client, &found.as.waves, now_ns);
        else client->counts[COGRIP_UNFIT]++;
        break;
    case TAG_PARTNER:
        if (!of_session(client, found.as.partners.session, now_ns)) break;
        if (client->scheme->tag == TAG_PARTNER) take_partners(client, &found.as.partners, now_ns);
        else client->counts[COGRIP_UNFIT]++;
        break;
    case TAG_HEARTBEAT:
        if (!of_session(client, found.as.heartbeat.session, now_ns)) break;
        read_stamp(client, &found.as.heartbeat.sent, now_ns);
        if (!client->begun) client->fresh_ns = now_ns; /* the server's line begins with the hand's first frame */
        break;
    case TAG_SET_HAND:
        if (!of_session(client, found.as.hand.session, now_ns) || !found.as.hand.number) break;
        if (client->hand_session != client->seat.session) client->hand_changes = client->hand_reports = 0;
        client->hand_session = client->seat.session;
        if (found.as.hand.number > client->hand_changes + 1) break;
        if (found.as.hand.number > client->hand_changes) client->hand_changes = found.as.hand.number;
        write_hand(client, outbox_push(client));
        break;
    case TAG_EFFECTS:
        if (of_session(client, found.as.effects.session, now_ns)) take_effects(client, &found.as.effects);
        break;
    case TAG_RESTART: break;
    case TAG_FAREWELL:
        if (of_session(client, found.as.farewell.session, now_ns)) take_farewell(client, &found.as.farewell);
        break;
    default: client->counts[COGRIP_UNEXPECTED]++;
    }
}

static void repeat_hello(cogrip_client *client, int64_t now_ns) {
    if (now_ns < client->next_ns) return;
    client->next_ns = now_ns + HELLO_EVERY_NS;
    write_hello(client, outbox_push(client));
}

/* True once no force is left on the hand, and the server knows that the line has released the object. */
static int released(cogrip_client *client) {
    if (client->tick < 0) return 1;
    const int64_t since = client->tick - client->stopped, second = client->seat.seat.device_hz;
    if (!quiet(client) || (double)since < RELEASE_S * (double)second) return 0;
    if (client->state != COGRIP_SEATED) return 1;
    if (client->parting < 0) client->parting = client->line.up.next;
    return client->line.acknowledged >= client->parting || since >= second;
}

void cogrip_poll(cogrip_client *client, int64_t now_ns) {
    const int64_t silent_ns = now_ns - client->last_received_ns;
    const int seated = client->state == COGRIP_SEATED || client->state == COGRIP_RESUMING;
    if (seated && client->ending && (released(client) || now_ns - client->ending_ns > 2 * LOST_NS)) {
        send_leave(client, client->reason);
        client->state = COGRIP_LEAVING;
        client->since_ns = client->next_ns = now_ns;
    }
    switch (client->state) {
    case COGRIP_CONNECTING:
        if (now_ns - client->since_ns >= GIVE_UP_NS) close_session(client, "no server answered within 3 s");
        else repeat_hello(client, now_ns);
        break;
    case COGRIP_SEATED:
        if (!client->seat.ticket[0] && silent_ns > LOST_NS) {
            close_session(client, "the server has been silent for 2 s");
        } else if (client->seat.ticket[0] && silent_ns >= QUIET_NS) {
            client->state = COGRIP_RESUMING;
            client->next_ns = now_ns;
            repeat_hello(client, now_ns);
        /* no hand yet, so no waves: the seat is kept all the same */
        } else if (!client->has_origin && now_ns >= client->next_ns) {
            client->next_ns = now_ns + HEARTBEAT_EVERY_NS;
            write_heartbeat(client, outbox_push(client), now_ns);
        }
        break;
    case COGRIP_RESUMING:
        if (silent_ns >= RESUME_GIVE_UP_NS) close_session(client, "no server for 10 s");
        else repeat_hello(client, now_ns);
        break;
    case COGRIP_LEAVING:
        if (now_ns - client->since_ns >= LEAVE_GIVE_UP_NS) {
            client->state = COGRIP_CLOSED;
        } else if (now_ns >= client->next_ns) {
            client->next_ns += LEAVE_EVERY_NS;
            memcpy(outbox_push(client), &client->leaving, sizeof client->leaving);
        }
        break;
    default: break;
    }
}

/* ---- Ticks ----------------------------------------------------------------------------------- */

/* Take in a sample. Returns 1 where it says how the hand has moved. */
static int hand_moved(cogrip_client *client, int64_t elapsed, const double *position_m, const double *velocity_mps) {
    double place[AXES] = {0.0}, moved[AXES] = {0.0};
    const int axes = client->axes, begun = client->has_origin;
    memcpy(client->start_m, client->position_m, sizeof client->start_m);
    memcpy(client->start_mps, client->velocity_mps, sizeof client->start_mps);
    if ((double)elapsed * client->tick_s >= WATCHDOG_S) fail(client, "watchdog: the loop was away for 0.1 s or more; re-arm");
    if (!position_m) {
        client->counts[COGRIP_NO_SAMPLE]++;
        client->absent_ticks += (double)elapsed;
        if (client->absent_ticks * client->tick_s >= STALL_S)
            fail(client, "device stall: 20 ms or more without samples; check its cable and power, then re-arm");
        return 0;
    }
    for (int axis = 0; axis < axes; axis++) {
        place[axis] = position_m[axis] - client->offset_m[axis];
        moved[axis] = place[axis] - client->position_m[axis];
        if (!isfinite(position_m[axis]) || fabs(position_m[axis]) > 1e3 || (velocity_mps && !isfinite(velocity_mps[axis]))) {
            fail(client, "the device gave a number that is not finite, or no place of a hand; re-arm once it is well");
            return 0;
        }
    }
    client->absent_ticks = most(0.0, client->absent_ticks - 0.5);
    if (begun && size_of(moved,
        axes) > JUMP_M + JUMP * client->config.speed_mps * client->tick_s * (double)(elapsed + (int64_t)client->absent_ticks)) {
        fail(client, "the device's position jumped as no hand does; re-arm once it is well");
        for (int axis = 0; axis < axes; axis++) client->offset_m[axis] += moved[axis]; /* go on from where the hand was */
        client->estimating = 0;
        return 0;
    }
    const double tick_s = client->tick_s * (double)most_int(1, elapsed);
    const double memory = estimator_memory(client);
    for (int axis = 0; axis < axes; axis++) { /* a critically damped alpha-beta filter (docs/velocity.md) */
        if (!client->estimating) {
            client->estimate_m[axis] = place[axis];
            client->estimate_mps[axis] = 0.0;
        }
        const double predicted = client->estimate_m[axis] + tick_s * client->estimate_mps[axis],
            error = place[axis] - predicted;
        client->estimate_m[axis] = predicted + (1.0 - memory * memory) * error;
        client->estimate_mps[axis] += (1.0 - memory) * (1.0 - memory) / tick_s * error;
        client->velocity_mps[axis] = velocity_mps ? velocity_mps[axis] : client->estimate_mps[axis];
        client->position_m[axis] = place[axis];
        if (!begun) client->start_m[axis] = place[axis];
    }
    client->estimating = 1;
    if (size_of(client->velocity_mps, axes) > client->config.speed_mps) fail(client, "over-speed: slow down, then re-arm");
    return 1;
}

/* Enter ticks that have passed. Returns 1 where a frame has ended. */
static int enter_ticks(cogrip_client *client, int64_t elapsed, int moved) {
    line *now = &client->line;
    const double rate = elapsed ? 1.0 / (client->tick_s * (double)elapsed) : 0.0;
    double mean[AXES] = {0.0}, hold = 1.0, work = 0.0;
    const double *velocity = client->start_mps;
    int ended = 0;
    for (int axis = 0; axis < client->axes && moved; axis++) {
        const double step = client->position_m[axis] - client->start_m[axis];
        work += client->force_n[axis] * step;
        mean[axis] = step * rate;
    }
    add(&client->work, work);
    effects_leave(&client->effects, client->force_n, client->partners.applied_n);
    if (moved && elapsed) effects_enter(&client->effects, client->force_n, client->start_m, client->position_m);
    if (client->stopped < 0) memcpy(client->mean_mps, mean, sizeof mean);
    /* a hand that goes on as it did */
    else hold = most(0.0, 1.0 - (double)(client->tick - client->stopped) * client->tick_s / RELEASE_S);
    if (!client->seat.seat.velocity_encoder || client->stopped >= 0) velocity = client->mean_mps;
    for (int64_t tick = client->tick - elapsed + 1; tick <= client->tick; tick++) {
        if (tick > client->wave_end) client->scheme->start_frame(client, tick - 1);
        if (client->safety == COGRIP_FAULT) client->scheme->elapse_absent(client);
        else client->scheme->elapse(client, mean, velocity, hold);
        if (tick < client->frame_end) continue;
        ended = 1;
        port_enter(client, client->closed_given_j + now->given.value);
        const int64_t length = client->scheme->end_frame(client, port_spare_j(client));
        port_enter(client, client->closed_given_j + now->given.value);
        if (moved) {
            port_end_frame(client, most_int(1, tick - client->frame_begin));
            memcpy(client->frame_start_m, client->position_m, sizeof client->frame_start_m);
        }
        client->frame_begin = tick;
        client->frame_end = tick + length;
    }
    port_enter(client, client->closed_given_j + now->given.value - (now->made_now_j - now->used_now_j));
    client->least_leak_j = least(client->least_leak_j,
        client->work.value - client->effects.work_j - (client->closed_port_j + port_j(now)));
    return ended;
}

void cogrip_sense(cogrip_client *client, int64_t tick, const double *position_m, const double *velocity_mps, int64_t now_ns) {
    if (client->seat.session && tick >= 0 && tick > client->tick) {
        const int64_t elapsed = client->tick < 0 ? 0 : tick - client->tick;
        if (client->tick < 0) { /* silence counts from the first tick: opening the device took its time */
            client->last_received_ns = client->fresh_ns = now_ns;
            client->first_tick = tick;
        }
        client->tick = tick;
        client->ticks_run++;
        if (elapsed > MOST_ABSENT_S * client->seat.seat.device_hz) { /* the seat is lost: nothing of that time is entered */
            close_session(client, "the loop was away for 10 s or more");
            return;
        }
        const int moved = hand_moved(client, elapsed, position_m, velocity_mps);
        if (client->handle.known) handle_edges(client);
        if (client->has_origin) {
            const int ended = enter_ticks(client, elapsed, moved);
            if (client->state == COGRIP_SEATED && ended) {
                client->scheme->write(client, outbox_push(client), now_ns);
                client->handle.edged = 0;
                client->handle.at_once = MOST_AT_ONCE;
            } else if (client->state == COGRIP_SEATED) {
                write_edges(client, now_ns);
            }
        } else if (moved) {
            client->has_origin = 1;
            memcpy(client->origin_m, client->position_m, sizeof client->origin_m);
            memcpy(client->frame_start_m, client->position_m, sizeof client->frame_start_m);
            client->frame_begin = tick - tick % client->ticks_per_frame;
            client->frame_end = client->frame_begin + client->ticks_per_frame;
        }
    }
    cogrip_poll(client, now_ns);
}

void cogrip_act(cogrip_client *client, double *force_n, int64_t now_ns) {
    double wish[AXES] = {0.0}, wanted[AXES] = {0.0}, out[AXES] = {0.0}, change[AXES] = {0.0};
    const int axes = client->axes;
    for (int axis = 0; axis < AXES; axis++) force_n[axis] = 0.0;
    if (!client->seat.session || client->tick < 0) return;
    if (client->tick >= client->wave_end) {
        client->scheme->start_frame(client, client->tick);
        if (client->line.down.played) { /* records come in clumps: a frame played in its time is as good as a new one */
            client->begun = 1;
            client->fresh_ns = now_ns;
        }
    }
    client->acted = client->tick;
    if (client->state == COGRIP_CLOSED) {
        release(client);
    } else if (client->state == COGRIP_RESUMING || now_ns - client->fresh_ns > STALE_NS) {
        if (client->safety == COGRIP_LIVE) {
            client->safety = COGRIP_STALE;
            copy_text(client->why, sizeof client->why, "nothing new from the server");
        }
    } else if (client->safety == COGRIP_STALE) {
        client->safety = COGRIP_LIVE;
        client->why[0] = '\0';
    }
    const int wished = client->safety != COGRIP_FAULT;
    int shortened = 0;
    if (wished) {
        const double used = -client->balance_j / client->free_j;
        const double damping = least(client->config.carried_nspm, client->damper_nspm);
        const double over = (used - TOLERATED_FRACTION) / (1.0 - TOLERATED_FRACTION);
        const double injected = used > TOLERATED_FRACTION ? INJECTED_FRACTION * damping * least(1.0, over) : 0.0;
        client->scheme->law(client, wanted);
        effects_step(&client->effects, client->tick, client->position_m, client->velocity_mps, coming_gain(client, 1));
        for (int axis = 0; axis < axes; axis++) {
            if (client->effects.asked) wanted[axis] += client->effects.asked_n[axis];
            client->effects.law_n[axis] = wanted[axis];
        }
        for (int axis = 0; axis < axes; axis++) wish[axis] = wanted[axis] += injected * client->velocity_mps[axis];
        shortened = port_limit(client, wanted);
    } else {
        effects_begin_anew(&client->effects);
    }
    const int limited = limit(client, wished ? wanted : NULL, client->line.down.gap, out);
    client->ramped = client->gain != 1.0;
    client->cut = 0;
    if (client->safety == COGRIP_LIVE) {
        client->forced_ticks++;
        client->limited_ticks += limited;
        client->controlled_ticks += shortened || client->ratio != 1.0 || client->deflected || client->effects.reduced;
        for (int axis = 0; axis < axes && !client->ramped; axis++) { /* the line does not see what limits took */
            client->cut_n[axis] = wish[axis] - client->law_n[axis];
            if (client->effects.asked) /* nor is the effects' part of that its own */
                client->cut_n[axis] =
                    (1.0 - part_of(client->law_n, wish, axes)) * (wish[axis] - client->effects.asked_n[axis]);
            client->cut = client->cut || client->cut_n[axis] != 0.0;
        }
    }
    for (int axis = 0; axis < axes; axis++) {
        change[axis] = out[axis] - client->force_n[axis];
        force_n[axis] = client->force_n[axis] = out[axis];
    }
    client->peak_force_n = most(client->peak_force_n, size_of(out, axes));
    client->peak_step_n = most(client->peak_step_n, size_of(change, axes));
}

/* ---- What is called from outside ------------------------------------------------------------- */

static int text_fits(const char *text, size_t bytes) {
    return !text || (strlen(text) <= bytes && code_points((const unsigned char *)text, strlen(text)) >= 0);
}

const char *cogrip_version(void) { return COGRIP_VERSION; }
int cogrip_abi(void) { return COGRIP_ABI; }
size_t cogrip_client_bytes(void) { return COGRIP_CLIENT_BYTES; }

/* Take a config of a program that was compiled with another cogrip.h: what an older one lacks is 0, what a newer one has more
 * must be 0. Returns 0 where it is not. */
static int take_config(cogrip_config *into, const cogrip_config *from, size_t bytes) {
    const unsigned char *at = (const unsigned char *)from;
    memset(into, 0, sizeof *into);
    memcpy(into, from, bytes < sizeof *into ? bytes : sizeof *into);
    for (size_t more = sizeof *into; more < bytes; more++)
        if (at[more]) return 0;
    return 1;
}

cogrip_client *cogrip_init(
    void *memory, size_t bytes, const cogrip_config *asked, size_t config_bytes, char *error, size_t error_bytes) {
    cogrip_client *client = (cogrip_client *)memory;
    cogrip_config given, *config = &given;
    const char *wrong = NULL;
    const int known = take_config(config, asked, config_bytes);
    if (!memory || bytes < sizeof *client) wrong = "memory: give COGRIP_CLIENT_BYTES";
    else if (!known) wrong = "config: a setting that this library does not know yet; install a newer libcogrip";
    else if (config->axes < 1 || config->axes > AXES) wrong = "axes: 1 to 3";
    else if (!(config->rate_hz >= (double)LEAST_DEVICE_HZ && config->rate_hz <= 1e6)) wrong = "rate_hz: 250 to 10^6";
    else if (!(config->peak_force_n > 0.0 && config->peak_force_n < NO_BOUND)) wrong = "peak_force_n: above 0, below 10^6";
    else if (!(config->speed_mps > 0.0 && config->speed_mps < NO_BOUND)) wrong = "speed_mps: above 0, below 10^6";
    else if (!(config->slew_nps >= 0.0 && config->apparent_mass_kg >= 0.0 && config->damping_nspm >= 0.0
        && config->carried_nspm >= 0.0))
        wrong = "slew_nps, apparent_mass_kg, damping_nspm, carried_nspm: 0 or more";
    else if (config->nonce > INT64_MAX) wrong = "nonce: below 2^63";
    else if (!text_fits(config->room, 40) || !text_fits(config->name, 40) || !text_fits(config->device, 200)
        || !text_fits(config->software, 40))
        wrong = "room, name, software: 40 bytes of UTF-8 at most, device: 200";
    else if (!text_fits(config->token, MOST_TOKEN)) wrong = "token: 640 characters at most";
    say(error, error_bytes, wrong ? wrong : "");
    if (wrong) return NULL;
    memset(client, 0, sizeof *client);
    client->config = *config;
    if (config->slew_nps == 0.0) client->config.slew_nps = MOST_SLOPE_NPS;
    if (config->apparent_mass_kg == 0.0) client->config.apparent_mass_kg = 0.1;
    if (config->carried_nspm == 0.0) client->config.carried_nspm = HUGE_VAL;
    copy_text(client->asked_room, sizeof client->asked_room, config->room ? config->room : "");
    copy_text(client->asked_name, sizeof client->asked_name, config->name ? config->name : "");
    copy_text(client->token, sizeof client->token, config->token ? config->token : "");
    copy_text(client->device, sizeof client->device, config->device && config->device[0] ? config->device : "c");
    copy_text(client->software, sizeof client->software, config->software && config->software[0] ? config->software : "c");
    client->config.room = client->config.name = client->config.token = client->config.device = client->config.software = NULL;
    client->tick = client->acted = client->stopped = client->parting = -1;
    client->later_j = -HUGE_VAL;
    client->down_reserve_j = HUGE_VAL;
    client->ramped = 1;
    client->ratio = 1.0;
    client->goodbye.up_margin_j = client->goodbye.line_margin_j = NAN;
    client->handle.grip_m = NAN;
    client->handle.at_once = MOST_AT_ONCE;
    return client;
}

void cogrip_connect(cogrip_client *client, int64_t now_ns) {
    if (client->state != COGRIP_IDLE) return;
    client->state = COGRIP_CONNECTING;
    client->since_ns = client->next_ns = now_ns;
    cogrip_poll(client, now_ns);
}

size_t cogrip_next(cogrip_client *client, void *buffer, int *hello) {
    while (client->outbox_count) {
        const message *oldest = &client->outbox[client->outbox_first];
        client->outbox_first = (client->outbox_first + 1) % OUTBOX;
        client->outbox_count--;
        if (!oldest->bytes) continue;
        memcpy(buffer, oldest->data, oldest->bytes);
        if (hello) *hello = oldest->hello;
        return oldest->bytes;
    }
    return 0;
}

void cogrip_handle(cogrip_client *client, uint32_t buttons, const double *orientation, double grip_m) {
    handle *hand = &client->handle;
    double square = 0.0;
    const uint32_t before = hand->buttons;
    hand->known = 1;
    hand->buttons = buttons;
    if (hand->count == MOST_EDGES) /* it was pressed and released again while no edge can be told */
        for (uint32_t back = (before ^ buttons) & ~(buttons ^ hand->said); back; back &= back - 1)
            client->counts[COGRIP_EDGES_LEFT_OUT] += 2;
    for (int place = 0; orientation && place < 4; place++) square += orientation[place] * orientation[place];
    hand->turned = fabs(square - 1.0) <= UNIT;
    if (hand->turned) memcpy(hand->orientation, orientation, sizeof hand->orientation);
    hand->grip_m = fabs(grip_m) <= 1.0 ? grip_m : NAN;
}

void cogrip_leave(cogrip_client *client, const char *reason, int64_t now_ns) {
    if (client->ending) return;
    copy_text(client->reason, sizeof client->reason, reason && text_fits(reason, 300) ? reason : "");
    client->ending = 1;
    client->ending_ns = now_ns;
    if (client->seat.session) release(client);
    if (client->state == COGRIP_IDLE || client->state == COGRIP_CONNECTING) client->state = COGRIP_CLOSED;
}

void cogrip_rearm(cogrip_client *client) {
    if (client->safety != COGRIP_FAULT) return;
    client->safety = COGRIP_LIVE;
    client->gain = client->absent_ticks = 0.0;
    client->estimating = 0;
    client->at_limit = 0;
    client->why[0] = '\0';
    if (client->balance_j < 0.0) { /* one that nothing pays back would hold the force at 0 for ever */
        client->forgiven_j -= client->balance_j;
        client->cut_j += client->balance_j;
        client->balance_j = 0.0;
    }
}

int cogrip_done(const cogrip_client *client) { return client->state == COGRIP_CLOSED && (client->tick < 0 || quiet(client)); }

const char *cogrip_reason(const cogrip_client *client) { return client->failed[0] ? client->failed : client->why; }
uint64_t cogrip_count(const cogrip_client *client, int which) { return which >= 0
    && which < COGRIP_COUNTS ? client->counts[which] : 0; }
const char *cogrip_count_name(int which) { return which >= 0 && which < COGRIP_COUNTS ? count_names[which] : ""; }

static void fill_status(const cogrip_client *client, cogrip_status *status) {
    const settings *seat = &client->seat.seat;
    memset(status, 0, sizeof *status);
    status->state = client->state;
    status->safety = client->safety;
    status->tick = client->tick;
    status->rtt_ms = client->rtt.total ? client->rtt.newest_ms : NAN;
    status->down_margin_j = client->down_margin_j;
    status->device_margin_j = client->least_j + client->reserve_j;
    status->up_margin_j = client->goodbye.up_margin_j;
    status->line_margin_j = client->goodbye.line_margin_j;
    status->peak_force_n = client->peak_force_n;
    status->peak_step_n = client->peak_step_n;
    status->gain = client->gain;
    if (!client->seat.session) return;
    status->axes = client->axes;
    status->device_hz = seat->device_hz;
    status->network_hz = seat->network_hz;
    status->seat = seat->seat;
    status->impedance_nspm = client->b;
    status->rendered_npm = seat->rendered_npm;
    memcpy(status->position_m, client->position_m, sizeof status->position_m);
    memcpy(status->velocity_mps, client->velocity_mps, sizeof status->velocity_mps);
    memcpy(status->force_n, client->force_n, sizeof status->force_n);
    memcpy(status->object_m, client->object, sizeof client->object[0] * (size_t)client->axes);
    memcpy(status->object_mps, client->object + client->axes, sizeof client->object[0] * (size_t)client->axes);
    if (client->scheme->tag == TAG_WAVES)
        status->playout_frames = seat->automatic
            ? (double)buffer_depth(&client->line.down.buffer) / client->ticks_per_frame : seat->playout_frames;
    status->down = down_count(client);
    copy_text(status->room, sizeof status->room, seat->room);
    copy_text(status->user, sizeof status->user, seat->user);
}

/* Give a struct to a program that may have been compiled with an older or a newer cogrip.h. */
static void give(void *into, size_t into_bytes, const void *from, size_t from_bytes) {
    memset(into, 0, into_bytes);
    memcpy(into, from, into_bytes < from_bytes ? into_bytes : from_bytes);
}

void cogrip_get_status(const cogrip_client *client, cogrip_status *status, size_t status_bytes) {
    cogrip_status known;
    fill_status(client, &known);
    give(status, status_bytes, &known, sizeof known);
}

/* ---- Join links [12] ------------------------------------------------------------------------- */

static int hex_digit(int c) { return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A'
    && c <= 'F' ? c - 'A' + 10 : -1; }

static int is_ipv4(const char *at) {
    for (int part = 0; part < 4; part++) {
        int value = 0, digits = 0;
        for (; *at >= '0' && *at <= '9' && digits < 4; digits++) value = 10 * value + *at++ - '0';
        if (!digits || value > 255 || (digits > 1 && at[-digits] == '0') || *at++ != (part < 3 ? '.' : '\0')) return 0;
    }
    return 1;
}

/* An IPv6 address (RFC 4291, 2.2) without its zone. */
static int is_ipv6(const char *at) {
    int groups = 0, gaps = 0;
    if (at[0] == ':' && at[1] != ':') return 0;
    while (*at) {
        int digits = 0;
        if (at[0] == ':' && at[1] == ':') {
            gaps++;
            at += 2;
            continue;
        }
        if (is_ipv4(at)) {
            groups += 2;
            break;
        }
        while (hex_digit((unsigned char)at[digits]) >= 0) digits++;
        if (digits < 1 || digits > 4) return 0;
        groups++;
        at += digits;
        if (*at == ':' && at[1] != ':') {
            if (!*++at) return 0;
        } else if (*at && *at != ':') {
            return 0;
        }
    }
    return gaps ? gaps == 1 && groups < 8 : groups == 8;
}

/* Check a host, of which an IPv6 address may have a zone behind %. */
static const char *host_error(const char *host) {
    const char *zone = strchr(host, '%');
    char address[64];
    if (!host[0]) return "host: there is none; write a name or an address, such as 192.0.2.7";
    if (!strchr(host, ':')) {
        if (strlen(host) > 253) return "host: longer than 253 characters";
        for (const char *at = host; *at; at++)
            if (!is_letter((unsigned char)*at) && *at != '_' && (at == host || (*at != '.' && *at != '-')))
                return "host: write a name (letters, digits, . and -) or an address";
        return NULL;
    }
    const size_t bytes = zone ? (size_t)(zone - host) : strlen(host);
    if (bytes >= sizeof address) return "host: that is no IPv6 address";
    memcpy(address, host, bytes);
    address[bytes] = '\0';
    if (!is_ipv6(address)) return "host: that is no IPv6 address";
    if (!zone) return NULL;
    if (!zone[1] || strlen(zone + 1) > 40) return "host: that is no IPv6 address with a zone";
    for (const char *at = zone + 1; *at; at++)
        if (!is_letter((unsigned char)*at) && !strchr("._~-", *at)) return "host: that is no IPv6 address with a zone";
    return NULL;
}

/* Split HOST, HOST:PORT, [IPV6] or [IPV6]:PORT. */
static const char *split_place(char *text, const char *zone_mark, cogrip_target *target) {
    char *host = text, *rest;
    if (*text == '[') {
        host = text + 1;
        rest = strchr(host, ']');
        if (!rest || (rest[1] && rest[1] != ':')) return "write an IPv6 address as [ADDRESS]:PORT";
        *rest++ = '\0';
        char *zone = strstr(host, zone_mark);
        if (zone) memmove(zone + 1, zone + strlen(zone_mark), strlen(zone + strlen(zone_mark)) + 1), *zone = '%';
        if (!strchr(host, ':')) return "brackets are for IPv6 addresses; leave them out";
    } else {
        rest = strchr(text, ':');
        if (rest && strchr(rest + 1, ':')) return "an IPv6 address stands in brackets: [ADDRESS]:PORT";
        if (!rest) rest = text + strlen(text);
    }
    target->port = 47800;
    if (*rest == ':') {
        *rest++ = '\0';
        target->port = 0;
        for (const char *at = rest; *at; at++)
            target->port = *at < '0' || *at > '9' || at - rest > 4 ? 65536 : 10 * target->port + *at - '0';
        if (target->port < 1 || target->port > 65535) return "the port must be a number from 1 to 65535";
    }
    if (strlen(host) >= sizeof target->host) return "host: too long";
    copy_text(target->host, sizeof target->host, host);
    return host_error(host);
}

static const char *parse_link(char *text, cogrip_target *target) {
    char *room, *secret = strchr(text, '#'), *token;
    size_t length = 0, dots = 0;
    for (const char *at = text; *at; at++)
        if ((unsigned char)*at <= ' ') return "join link: there is a blank or a line break in it; a blank in a room is %20";
    if (!secret || !secret[1]) return "join link: the part after # is missing: copy the whole of it";
    *secret++ = '\0';
    token = strchr(secret, '.');
    if (!token) return "join link: behind the # must stand FINGERPRINT.TOKEN";
    *token++ = '\0';
    for (const char *at = secret; *at; at++, length++) {
        if (hex_digit((unsigned char)*at) < 0 || length >= 64)
            return "join link: the fingerprint must have 64 hexadecimal digits";
        target->fingerprint[length] = (char)(*at >= 'A' && *at <= 'F' ? *at - 'A' + 'a' : *at);
    }
    if (length != 64) return "join link: the fingerprint must have 64 hexadecimal digits";
    for (const char *at = token; *at; at++) {
        if (*at == '.') dots++;
        else if (!is_letter((unsigned char)*at) && *at != '-' && *at != '_')
            return "join link: the token must have letters, digits, - and _";
        if (*at == '.' && (at == token || at[1] == '.' || !at[1])) dots = 3; /* an empty part */
    }
    if (!dots && strlen(token) != 22) return "join link: the token must have 22 letters, digits, - and _";
    if (dots && (dots != 2 || strlen(token) > MOST_TOKEN))
        return "join link: a signed token must have three parts, and at most 640 characters";
    copy_text(target->token, sizeof target->token, token);
    room = strchr(text, '/');
    if (room) {
        *room++ = '\0';
        for (length = 0; *room; length++) {
            int letter = (unsigned char)*room++;
            if (letter == '%' && hex_digit((unsigned char)room[0]) >= 0 && hex_digit((unsigned char)room[1]) >= 0) {
                letter = 16 * hex_digit((unsigned char)room[0]) + hex_digit((unsigned char)room[1]);
                room += 2;
            }
            if (length >= 40 || (!is_letter(letter) && (!length || !letter || !strchr(" ._-", letter))))
                return "join link: no room is called so: at most 40 letters, digits, blanks and . _ -, a letter or digit first";
            target->room[length] = (char)letter;
        }
    }
    return split_place(text, "%25", target);
}

static const char *read_target(const char *text, cogrip_target *target) {
    static const char scheme[] = "cogrip:";
    char copy[1001];
    const char *wrong = NULL, *end;
    size_t same = 0;
    memset(target, 0, sizeof *target);
    while (*text && (unsigned char)*text <= ' ') text++;
    for (end = text + strlen(text); end > text && (unsigned char)end[-1] <= ' ';) end--;
    const size_t length = (size_t)(end - text);
    while (same < 7 && same < length && (text[same] | (text[same] >= 'A' && text[same] <= 'Z' ? 0x20 : 0)) == scheme[same])
        same++;
    if (length >= sizeof copy) {
        wrong = "target: more than 1000 characters; paste the link alone";
    } else {
        memcpy(copy, text, length);
        copy[length] = '\0';
        if (same == 7 && copy[7] == '/' && copy[8] == '/') wrong = parse_link(copy + 9, target);
        else if (same == 7 || strstr(copy, "://") || strchr(copy, '#'))
            wrong = "a join link begins with cogrip://HOST:PORT/ROOM#; copy the whole link";
        else wrong = split_place(copy, "%", target);
    }
    if (wrong) memset(target, 0, sizeof *target);
    return wrong;
}

int cogrip_parse_target(const char *text, cogrip_target *target, size_t target_bytes, char *error, size_t error_bytes) {
    cogrip_target read;
    const char *wrong = read_target(text, &read);
    give(target, target_bytes, &read, sizeof read);
    say(error, error_bytes, wrong ? wrong : "");
    return !wrong;
}

/* ---- Driver ---------------------------------------------------------------------------------- */

#ifndef COGRIP_NO_DRIVER
#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <arpa/inet.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#ifndef COGRIP_NO_DTLS
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#endif

enum { MOST_DATAGRAM_BYTES = 1232, MOST_DATAGRAMS = 64, MOST_MESSAGES = 16 }; /* of one path in one drain; of one datagram */
#define SHAKE_GIVE_UP_NS (10000 * MS)
#define REFUSED_NS (250 * MS)
#define SPARE_NS (2000 * MS)
static const int64_t again_ns[] = {500 * MS, 1000 * MS, 2000 * MS};

/* Address of a server. */
typedef struct endpoint {
    struct sockaddr_storage address;
    socklen_t bytes;
} endpoint;

/* A socket, and where the link says so a DTLS association [11]. */
typedef struct path {
    endpoint server;
    int open, fd, refused, ready;
    unsigned char datagram[MOST_DATAGRAM_BYTES + 1];
#ifndef COGRIP_NO_DTLS
    SSL *ssl;
    const unsigned char *pending; /* the datagram that OpenSSL reads next */
    int pending_bytes, wrote, failed, attempts, mismatch; /* mismatch: another certificate than the link's */
    int64_t begun_ns, answered_ns;
    const char *fingerprint;
#endif
} path;

struct cogrip_driver {
    cogrip_client client;
    cogrip_target target;
    endpoint known[MOST_FRONTS + 2]; /* the server of the link, and those that a redirect named: asked in turn in a silence */
    int known_count, asked, redirects, roams;
    endpoint last;     /* server of the seat */
    endpoint leads_to; /* of a redirect that is to be followed; without bytes: none is */
    path paths[2];
    int current, newer; /* places in `paths`; newer: opened since the server fell silent, -1 if none was */
    int tries, was_ready;
    int64_t since_ns, resumed_ns;
    message hello; /* waits for its path to be ready */
#ifndef COGRIP_NO_DTLS
    SSL_CTX *context;
    BIO_METHOD *method;
#endif
};
typedef char cogrip_driver_fits[sizeof(struct cogrip_driver) <= COGRIP_DRIVER_BYTES ? 1 : -1];

int64_t cogrip_now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

int64_t cogrip_sleep_until(int64_t due_ns) {
#ifdef __APPLE__ /* has no clock_nanosleep */
    const int64_t left_ns = most_int(0, due_ns - cogrip_now_ns());
    const struct timespec left = {(time_t)(left_ns / 1000000000), (long)(left_ns % 1000000000)};
    if (left_ns) nanosleep(&left, NULL);
#else
    const struct timespec due = {(time_t)(due_ns / 1000000000), (long)(due_ns % 1000000000)};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
#endif
    return cogrip_now_ns();
}

size_t cogrip_driver_bytes(void) { return COGRIP_DRIVER_BYTES; }

static void note_error(cogrip_driver *driver, path *way) {
    if (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR) return;
    way->refused = way->refused || errno == ECONNREFUSED;
    driver->client.counts[COGRIP_SOCKET_ERRORS]++;
}

#ifndef COGRIP_NO_DTLS

static int bio_write(BIO *bio, const char *data, int bytes) {
    path *way = (path *)BIO_get_data(bio);
    BIO_clear_retry_flags(bio);
    way->wrote = 1;
    if (send(way->fd, data, (size_t)bytes, 0) < 0) way->refused = way->refused || errno == ECONNREFUSED;
    return bytes; /* what the network does not take is lost, as on any path */
}

static int bio_read(BIO *bio, char *into, int bytes) {
    path *way = (path *)BIO_get_data(bio);
    BIO_clear_retry_flags(bio);
    if (!way->pending) {
        BIO_set_retry_read(bio);
        return -1;
    }
    const int kept = way->pending_bytes < bytes ? way->pending_bytes : bytes;
    memcpy(into, way->pending, (size_t)kept);
    way->pending = NULL; /* one call, one datagram */
    return kept;
}

static long bio_control(BIO *bio, int command, long number, void *data) {
    (void)bio, (void)number, (void)data;
    return command == BIO_CTRL_FLUSH || command == BIO_CTRL_DUP ? 1
           : command == BIO_CTRL_DGRAM_QUERY_MTU || command == BIO_CTRL_DGRAM_GET_FALLBACK_MTU ? MOST_DATAGRAM_BYTES
                                                                                               : 0;
}

static int bio_create(BIO *bio) {
    BIO_set_init(bio, 1);
    return 1;
}

/* Accept the certificate of the link alone, whoever signed it and whatever this machine's clock says [11.1]. */
static int certificate_fits(const X509 *certificate, const char *fingerprint) {
    static const char digits[] = "0123456789abcdef";
    unsigned char digest[EVP_MAX_MD_SIZE];
    unsigned bytes = 0;
    if (!certificate || !X509_digest(certificate, EVP_sha256(), digest, &bytes) || bytes != 32) return 0;
    for (int place = 0; place < 32; place++)
        if (fingerprint[2 * place] != digits[digest[place] >> 4] || fingerprint[2 * place + 1] != digits[digest[place] & 15])
            return 0;
    return 1;
}

static int verify(int ok, X509_STORE_CTX *store) {
    SSL *ssl = (SSL *)X509_STORE_CTX_get_ex_data(store, SSL_get_ex_data_X509_STORE_CTX_idx());
    path *way = (path *)SSL_get_app_data(ssl);
    (void)ok;
    const int fits = X509_STORE_CTX_get_error_depth(store) == 0
        && certificate_fits(X509_STORE_CTX_get_current_cert(store), way->fingerprint);
    way->mismatch = way->mismatch || !fits;
    return fits;
}

static int dtls_setup(cogrip_driver *driver) {
    SSL_CTX *context = driver->context = SSL_CTX_new(DTLS_client_method());
    BIO_METHOD *method = driver->method = BIO_meth_new(BIO_get_new_index() | BIO_TYPE_SOURCE_SINK, "cogrip");
    if (!context || !method) return 0;
    BIO_meth_set_write(method, bio_write);
    BIO_meth_set_read(method, bio_read);
    BIO_meth_set_ctrl(method, bio_control);
    BIO_meth_set_create(method, bio_create);
    SSL_CTX_set_options(context, SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_TICKET | SSL_OP_NO_COMPRESSION | SSL_OP_NO_QUERY_MTU);
    SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
    SSL_CTX_set_verify(context, SSL_VERIFY_PEER, verify);
    return SSL_CTX_set_min_proto_version(context, DTLS1_2_VERSION) && SSL_CTX_set_max_proto_version(context, DTLS1_2_VERSION) &&
           SSL_CTX_set_cipher_list(context,
               "ECDHE-ECDSA-AES128-GCM-SHA256:ECDHE-ECDSA-AES256-GCM-SHA384:ECDHE-ECDSA-CHACHA20-POLY1305");
}

/* Bring the handshake on. */
static void shake(path *way) {
    ERR_clear_error();
    const int result = SSL_do_handshake(way->ssl);
    if (result == 1) {
        X509 *certificate = SSL_get_peer_certificate(way->ssl);
        way->ready = certificate_fits(certificate, way->fingerprint); /* once more: whom it was with */
        way->mismatch = way->mismatch || !way->ready;
        X509_free(certificate);
    } else if (SSL_get_error(way->ssl, result) != SSL_ERROR_WANT_READ) {
        way->failed = 1;
    }
}

static void dtls_begin(cogrip_driver *driver, path *way, int64_t now_ns) {
    if (way->ssl) SSL_free(way->ssl);
    way->ssl = SSL_new(driver->context);
    BIO *bio = way->ssl ? BIO_new(driver->method) : NULL;
    if (way->attempts++) driver->client.counts[COGRIP_HANDSHAKES]++;
    way->answered_ns = now_ns;
    way->failed = 0;
    if (!bio) {
        way->failed = 1;
        return;
    }
    BIO_set_data(bio, way);
    SSL_set_app_data(way->ssl, way);
    SSL_set_bio(way->ssl, bio, bio);
    SSL_set_mtu(way->ssl, MOST_DATAGRAM_BYTES);
    SSL_set_connect_state(way->ssl);
    shake(way);
}

/* Go on with a handshake: a flight without an answer is repeated, later the handshake begins anew [11.2]. Returns why it
 * ended, or NULL. */
static const char *dtls_poll(cogrip_driver *driver, path *way, int64_t now_ns) {
    static const int64_t patience_ns[] = {500 * MS, 700 * MS, 900 * MS};
    if (way->ready) return NULL;
    if (way->mismatch)
        return "the server's certificate is not the one of the link: this is another server, or it was set up anew; "
               "ask for a new link";
    if (!way->attempts) {
        way->begun_ns = now_ns;
        dtls_begin(driver, way, now_ns);
    } else if (now_ns - way->begun_ns >= SHAKE_GIVE_UP_NS) {
        return "no encrypted server answered within 10 s: is it running with DTLS, and is its UDP port open and forwarded?";
    } else if (now_ns - way->answered_ns >= patience_ns[way->attempts < 3 ? way->attempts - 1 : 2]) {
        dtls_begin(driver, way, now_ns);
    } else if (way->ssl && !way->failed) {
        ERR_clear_error();
        if (DTLSv1_handle_timeout(way->ssl) < 0) way->failed = 1;
    }
    return NULL;
}
#endif

/* Make a text of why the driver could not do what it was asked. */
static void explain(char *error, size_t bytes, const char *what, const char *why) {
    if (error && bytes) snprintf(error, bytes, "%s: %s", what, why);
}

static int path_open(cogrip_driver *driver, path *way, const endpoint *server) {
    const int fd = socket(server->address.ss_family, SOCK_DGRAM, 0);
    memset(way, 0, sizeof *way);
    way->server = *server;
    if (fd < 0) return 0;
    if (fcntl(fd, F_SETFL, O_NONBLOCK) < 0 || fcntl(fd, F_SETFD, FD_CLOEXEC) < 0 ||
        connect(fd, (const struct sockaddr *)&server->address, server->bytes) < 0) {
        driver->client.counts[COGRIP_SOCKET_ERRORS]++;
        close(fd);
        return 0;
    }
    way->open = 1;
    way->fd = fd;
    way->ready = !driver->target.fingerprint[0];
#ifndef COGRIP_NO_DTLS
    way->fingerprint = driver->target.fingerprint;
#endif
    return 1;
}

static void path_close(path *way) {
    if (!way->open) return;
#ifndef COGRIP_NO_DTLS
    if (way->ssl) {
        ERR_clear_error();
        if (way->ready && !way->failed) SSL_shutdown(way->ssl);
        SSL_free(way->ssl);
        way->ssl = NULL;
    }
#endif
    close(way->fd);
    way->open = 0;
}

static void path_send(cogrip_driver *driver, path *way, const message *out) {
    if (!way->open || !way->ready) return;
#ifndef COGRIP_NO_DTLS
    if (way->ssl) {
        ERR_clear_error();
        if (!way->failed && SSL_write(way->ssl, out->data, (int)out->bytes) <= 0) way->failed = 1;
        return;
    }
#endif
    if (send(way->fd, out->data, out->bytes, 0) < 0) note_error(driver, way);
}

static int is_loopback(const struct sockaddr_storage *address) {
    if (address->ss_family == AF_INET)
        return (ntohl(((const struct sockaddr_in *)(const void *)address)->sin_addr.s_addr) >> 24) == 127;
    return address->ss_family == AF_INET6
        && IN6_IS_ADDR_LOOPBACK(&((const struct sockaddr_in6 *)(const void *)address)->sin6_addr);
}

static int same_place(const endpoint *one, const endpoint *other) {
    return one->bytes == other->bytes && !memcmp(&one->address, &other->address, one->bytes);
}

/* Read ADDRESS:PORT or [ADDRESS]:PORT; nothing is looked up. */
static int read_place(const char *text, endpoint *into) {
    char host[64], *end;
    const char *colon = strrchr(text, ':');
    const size_t length = colon ? (size_t)(colon - text) : 0;
    const long port = colon && colon[1] >= '0' && colon[1] <= '9' ? strtol(colon + 1, &end, 10) : 0;
    memset(into, 0, sizeof *into);
    if (port < 1 || port > 65535 || *end || length < 3 || length >= sizeof host) return 0;
    memcpy(host, text, length);
    host[length] = 0;
    if (host[0] == '[' && host[length - 1] == ']') {
        struct sockaddr_in6 *const far = (struct sockaddr_in6 *)(void *)&into->address;
        host[length - 1] = 0;
        far->sin6_family = AF_INET6;
        far->sin6_port = htons((uint16_t)port);
        into->bytes = sizeof *far;
        return inet_pton(AF_INET6, host + 1, &far->sin6_addr) == 1;
    }
    struct sockaddr_in *const far = (struct sockaddr_in *)(void *)&into->address;
    far->sin_family = AF_INET;
    far->sin_port = htons((uint16_t)port);
    into->bytes = sizeof *far;
    return inet_pton(AF_INET, host, &far->sin_addr) == 1;
}

/* Note where a redirect leads; `go_on` opens the path once nothing is read from those that are there [4.5].
 * False for what is to be dropped. */
static int take_redirect(cogrip_driver *driver, const redirect *given) {
    const cogrip_state state = driver->client.state;
    endpoint found;
    if (state != COGRIP_CONNECTING && state != COGRIP_RESUMING) return 0;
    if (given->nonce != (int64_t)driver->client.config.nonce) return 0;
    if (!read_place(given->places[0], &found) || driver->redirects >= MOST_REDIRECTS) return 0;
    if (!driver->roams && is_loopback(&driver->known[0].address) && !is_loopback(&found.address)) return 0;
    if (same_place(&found, &driver->paths[driver->newer >= 0 ? driver->newer : driver->current].server)) return 1;
    driver->leads_to = found;
    driver->known_count = 1;
    for (int front = 1; front < given->count; front++)
        if (read_place(given->places[front], &found)) driver->known[driver->known_count++] = found;
    driver->asked = 0;
    return 1;
}

static void take_message(cogrip_driver *driver, path *way, const unsigned char *data, size_t bytes, int64_t now_ns) {
    decoded found;
    decode(data, bytes, &found);
    if (found.tag == TAG_REDIRECT && take_redirect(driver, &found.as.redirect)) return;
    if (driver->newer >= 0 && found.tag == TAG_WELCOME && found.as.welcome.nonce == (int64_t)driver->client.config.nonce) {
        const int place = (int)(way - driver->paths); /* by whichever path: that one is used from now on */
        path_close(&driver->paths[!place]);
        driver->current = place;
        driver->newer = -1;
        driver->redirects = driver->asked = 0;
        driver->leads_to.bytes = 0;
    }
    cogrip_receive(&driver->client, data, bytes, now_ns);
}

static void path_feed(cogrip_driver *driver, path *way, size_t bytes, int64_t now_ns) {
#ifndef COGRIP_NO_DTLS
    if (driver->target.fingerprint[0]) {
        unsigned char text[COGRIP_MESSAGE_BYTES + 1];
        if (way->datagram[0] < 20 || way->datagram[0] > 23) {
            driver->client.counts[COGRIP_NOT_SEALED]++;
            return;
        }
        if (!way->ssl || way->failed) return;
        way->pending = way->datagram;
        way->pending_bytes = (int)bytes;
        way->wrote = 0;
        if (!way->ready) shake(way);
        if (way->wrote) way->answered_ns = now_ns; /* only what brings the handshake on counts as an answer */
        for (int count = 0; way->ready && count < MOST_MESSAGES; count++) {
            ERR_clear_error();
            const int got = SSL_read(way->ssl, text, sizeof text);
            if (got <= 0) {
                way->failed = SSL_get_error(way->ssl, got) != SSL_ERROR_WANT_READ;
                break;
            }
            take_message(driver, way, text, (size_t)got, now_ns);
        }
        way->pending = NULL;
        return;
    }
#endif
    take_message(driver, way, way->datagram, bytes, now_ns);
}

/* Take in what has come, MOST_DATAGRAMS at most of each path: a flood may not hold a tick up. */
static void drain(cogrip_driver *driver, int64_t now_ns) {
    for (int place = 0; place < 2; place++) {
        path *way = &driver->paths[place];
        for (int count = 0; count < MOST_DATAGRAMS && way->open; count++) {
            const ssize_t bytes = recv(way->fd, way->datagram, sizeof way->datagram, 0);
            if (bytes < 0) {
                note_error(driver, way);
                break;
            }
            way->refused = 0;
            if (bytes > MOST_DATAGRAM_BYTES) driver->client.counts[COGRIP_TOO_LARGE]++;
            else if (bytes) path_feed(driver, way, (size_t)bytes, now_ns);
        }
    }
}

static path *newest_path(cogrip_driver *driver) { return &driver->paths[driver->newer >= 0 ? driver->newer : driver->current]; }

static void open_newer(cogrip_driver *driver, const endpoint *server, int64_t now_ns) {
    const int place = !driver->current;
    path_close(&driver->paths[place]);
    driver->newer = path_open(driver, &driver->paths[place], server) ? place : -1;
    driver->since_ns = now_ns;
    driver->resumed_ns = -1;
    driver->was_ready = 0;
    driver->tries++;
}

/* Open another path while the server is silent; close it once it is not needed any more [4.4]. */
static void migrate(cogrip_driver *driver, int64_t now_ns) {
    if (driver->client.state != COGRIP_RESUMING) {
        driver->tries = driver->asked = 0;
        if (driver->newer < 0) return;
        if (driver->resumed_ns < 0) driver->resumed_ns = now_ns;
        if (now_ns - driver->resumed_ns < SPARE_NS) return;
        path_close(&driver->paths[driver->newer]);
        driver->newer = -1;
        return;
    }
    const path *newest = newest_path(driver);
    const int ready = driver->newer >= 0 && newest->ready;
    driver->resumed_ns = -1;
    if (ready && !driver->was_ready) driver->since_ns = now_ns;
    driver->was_ready = ready;
    const int64_t wait_ns = !driver->tries ? 0 : newest->refused ? REFUSED_NS
        : again_ns[ready || driver->tries > 2 ? 2 : driver->tries - 1];
    if (driver->tries && now_ns - driver->since_ns < wait_ns) return;
    if (!driver->tries) driver->last = driver->paths[driver->current].server; /* whom it was seated at is asked first */
    const int turn = driver->asked++ % (driver->known_count + 1);
    driver->redirects = 0;
    open_newer(driver, turn ? &driver->known[turn - 1] : &driver->last, now_ns);
}

static void send_all(cogrip_driver *driver) {
    message out;
    while ((out.bytes = cogrip_next(&driver->client, out.data, &out.hello))) {
        path *way = out.hello ? newest_path(driver) : &driver->paths[driver->current];
        if (out.hello && !way->ready) memcpy(&driver->hello, &out, sizeof out);
        else path_send(driver, way, &out);
    }
    if (driver->hello.bytes && newest_path(driver)->ready) {
        path_send(driver, newest_path(driver), &driver->hello);
        driver->hello.bytes = 0;
    }
}

static void go_on(cogrip_driver *driver, int64_t now_ns) {
    cogrip_client *client = &driver->client;
#ifndef COGRIP_NO_DTLS
    for (int place = 0; place < 2 && driver->target.fingerprint[0]; place++) {
        const char *why = driver->paths[place].open ? dtls_poll(driver, &driver->paths[place], now_ns) : NULL;
        if (why && client->state == COGRIP_IDLE) close_session(client, why); /* else: there is no seat by this path */
    }
#endif
    if (client->state == COGRIP_IDLE && driver->paths[driver->current].ready) cogrip_connect(client, now_ns);
    if (driver->leads_to.bytes) {
        driver->redirects++;
        open_newer(driver, &driver->leads_to, now_ns);
        driver->leads_to.bytes = 0;
    }
    migrate(driver, now_ns);
    send_all(driver);
}

static int draw_nonce(uint64_t *nonce) {
    const int fd = open("/dev/urandom", O_RDONLY);
    const int drawn = fd >= 0 && read(fd, nonce, sizeof *nonce) == (ssize_t)sizeof *nonce;
    if (fd >= 0) close(fd);
    *nonce >>= 1;
    return drawn;
}

cogrip_driver *cogrip_open(
    void *memory, size_t bytes, const char *target, const cogrip_config *config, size_t config_bytes, int allow_unencrypted,
    char *error, size_t error_bytes) {
    cogrip_driver *driver = (cogrip_driver *)memory;
    cogrip_config asked;
    struct addrinfo hints, *found = NULL;
    char port[8];
    if (!memory || bytes < sizeof *driver) {
        say(error, error_bytes, "memory: give COGRIP_DRIVER_BYTES");
        return NULL;
    }
    if (!take_config(&asked, config, config_bytes)) {
        say(error, error_bytes, "config: a setting that this library does not know yet; install a newer libcogrip");
        return NULL;
    }
    memset(driver, 0, sizeof *driver);
    driver->newer = -1;
    driver->resumed_ns = -1;
    if (!cogrip_parse_target(target, &driver->target, sizeof driver->target, error, error_bytes)) return NULL;
    if (driver->target.token[0]) asked.token = driver->target.token;
    if (driver->target.room[0]) asked.room = driver->target.room;
    if (!draw_nonce(&asked.nonce)) {
        say(error, error_bytes, "/dev/urandom cannot be read");
        return NULL;
    }
    if (!cogrip_init(&driver->client, sizeof driver->client, &asked, sizeof asked, error, error_bytes)) return NULL;
    memset(&hints, 0, sizeof hints);
    hints.ai_socktype = SOCK_DGRAM;
    snprintf(port, sizeof port, "%d", driver->target.port);
    const int status = getaddrinfo(driver->target.host, port, &hints, &found);
    if (status) {
        explain(error, error_bytes, driver->target.host, gai_strerror(status));
        return NULL;
    }
    memcpy(&driver->known[0].address, found->ai_addr, found->ai_addrlen);
    driver->known[0].bytes = found->ai_addrlen;
    driver->known_count = 1;
    driver->roams = allow_unencrypted || driver->target.fingerprint[0];
    freeaddrinfo(found);
    if (!driver->target.fingerprint[0] && !allow_unencrypted && !is_loopback(&driver->known[0].address)) {
        explain(error, error_bytes, driver->target.host,
            "unencrypted to another machine; join by the server's link, or allow it");
        return NULL;
    }
#ifdef COGRIP_NO_DTLS
    if (driver->target.fingerprint[0]) {
        say(error, error_bytes, "this program was built without DTLS (COGRIP_NO_DTLS): no join link can be used");
        return NULL;
    }
#else
    if (driver->target.fingerprint[0] && !dtls_setup(driver)) {
        say(error, error_bytes, "OpenSSL: no DTLS 1.2 with ECDHE, ECDSA and an AEAD here");
        cogrip_close(driver);
        return NULL;
    }
#endif
    if (!path_open(driver, &driver->paths[0], &driver->known[0])) {
        explain(error, error_bytes, driver->target.host, "no socket to it; check the network of this machine");
        cogrip_close(driver);
        return NULL;
    }
    go_on(driver, cogrip_now_ns());
    return driver;
}

cogrip_state cogrip_run(cogrip_driver *driver) {
    const int64_t now_ns = cogrip_now_ns();
    drain(driver, now_ns);
    cogrip_poll(&driver->client, now_ns);
    go_on(driver, now_ns);
    return driver->client.state;
}

void cogrip_tick(cogrip_driver *driver, int64_t tick, const double *position_m, const double *velocity_mps, double *force_n) {
    const int64_t now_ns = cogrip_now_ns();
    cogrip_sense(&driver->client, tick, position_m, velocity_mps, now_ns);
    send_all(driver);
    drain(driver, cogrip_now_ns()); /* what came since the tick began was sent by a server that had it so long */
    cogrip_act(&driver->client, force_n, now_ns);
    go_on(driver, now_ns);
}

cogrip_client *cogrip_client_of(cogrip_driver *driver) { return &driver->client; }
void cogrip_driver_leave(cogrip_driver *driver, const char *reason) { cogrip_leave(&driver->client, reason, cogrip_now_ns()); }

void cogrip_close(cogrip_driver *driver) {
    for (int place = 0; place < 2; place++) path_close(&driver->paths[place]);
#ifndef COGRIP_NO_DTLS
    SSL_CTX_free(driver->context);
    BIO_meth_free(driver->method);
    driver->context = NULL;
    driver->method = NULL;
#endif
}
#endif
