/* A client of cogrip for one person's seat, in C99: the client's side of protocol/SPEC.md, for waves and for
 * models of partners.
 *
 * The core takes datagrams, positions and times, and gives forces and datagrams. It opens no socket, asks no clock and
 * allocates
 * nothing: all of its state lies in COGRIP_CLIENT_BYTES that the caller provides. The driver (second half) adds UDP, DTLS and
 * a clock.
 *
 * Units are SI and stand in names. The sign of force is that of all of cogrip: a positive force resists motion in +x, so the
 * motors
 * push the hand with -force_n. One thread at a time may use a client.
 *
 * Switches for the compiler:  COGRIP_NO_DRIVER  the core alone, ISO C99;  COGRIP_NO_DTLS  a driver without encryption.
 * docs/c_client.md has the guide.
 */
#ifndef COGRIP_H
#define COGRIP_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#ifndef COGRIP_API
#if defined(__GNUC__) && defined(COGRIP_SHARED) /* while the shared library is compiled: these symbols, and no others */
#define COGRIP_API __attribute__((visibility("default")))
#else
#define COGRIP_API
#endif
#endif

/* Binary interface of the shared library, and number of its soname. Within one number a newer library serves an older
 * program: functions are only added, structs and enums grow at their end alone, and the constants of memory stay. So every
 * struct is handed over with its size. */
#define COGRIP_ABI 0
#define COGRIP_VERSION "0.1.0"
#define COGRIP_PROTOCOL 1           /* version of the protocol */
#define COGRIP_AXES 3               /* most axes of a hand */
#define COGRIP_MESSAGE_BYTES 1195   /* longest message */
#define COGRIP_TEXT_BYTES 301       /* longest text, with its end */
#define COGRIP_CLIENT_BYTES 409600  /* memory of a client */

typedef struct cogrip_client cogrip_client;

/* Of the library that is linked: COGRIP_VERSION, COGRIP_ABI and memory as it was compiled with. */
COGRIP_API const char *cogrip_version(void);
COGRIP_API int cogrip_abi(void);
COGRIP_API size_t cogrip_client_bytes(void);

/* What a hand is held with. A number that is 0 takes the value in brackets; texts that are NULL are empty. */
typedef struct cogrip_config {
    const char *room;        /* [any] */
    const char *name;        /* of the seat [any free one] */
    const char *token;       /* from the join link [none] */
    const char *device;      /* what the device is called, at most 200 bytes ["c"] */
    const char *software;    /* version of the program, at most 40 bytes ["c"] */
    uint64_t nonce;          /* from a cryptographic source, new for every client; the driver draws it */
    int axes;                /* of the device, 1 to 3 */
    double rate_hz;          /* fastest loop that the device allows */
    double peak_force_n;     /* largest force, of all axes together */
    double speed_mps;        /* over-speed limit */
    double slew_nps;         /* steepest force [1000, and never more] */
    double apparent_mass_kg; /* of the device at the hand [0.1] */
    double damping_nspm;     /* of the device itself [0] */
    double carried_nspm;     /* largest damping that the device renders without shaking [no bound] */
} cogrip_config;

typedef enum cogrip_state {
    COGRIP_IDLE, COGRIP_CONNECTING, COGRIP_SEATED, COGRIP_RESUMING, COGRIP_LEAVING, COGRIP_CLOSED
} cogrip_state;

/* Only COGRIP_LIVE lets force through; every change between these ramps it. COGRIP_FAULT lasts until cogrip_rearm. */
typedef enum cogrip_safety { COGRIP_RELEASED, COGRIP_LIVE, COGRIP_STALE, COGRIP_FAULT } cogrip_safety;

/* What was dropped, or dealt with, by name: index of cogrip_count and cogrip_count_name. */
enum {
    COGRIP_MALFORMED, COGRIP_UNEXPECTED, COGRIP_OTHER_SESSION, COGRIP_OTHER_NONCE, COGRIP_UNFIT, COGRIP_EARLY,
    COGRIP_IMPLAUSIBLE_STAMP, COGRIP_IMPLAUSIBLE_WAVE, COGRIP_FORCE_CLIPPED, COGRIP_SLEW_LIMITED, COGRIP_NO_SAMPLE,
    COGRIP_FAULTS, COGRIP_EDGES_LEFT_OUT, COGRIP_OUTBOX_FULL, COGRIP_TOO_LARGE, COGRIP_NOT_SEALED, COGRIP_SOCKET_ERRORS,
    COGRIP_HANDSHAKES, COGRIP_RESUMED, COGRIP_RENEWED, COGRIP_LATE_EFFECTS,
    COGRIP_UNFIT_EFFECT, COGRIP_COUNTS
};

/* Frames of one direction (SPEC.md 6): sent = applied + late + lost. */
typedef struct cogrip_link_count {
    int64_t sent, received, applied, lost, late, duplicate, pending;
} cogrip_link_count;

/* All that one may want to show. Margins are nan where nothing is known. */
typedef struct cogrip_status {
    cogrip_state state;
    cogrip_safety safety;
    int axes, device_hz, network_hz, seat; /* 0 before there is a seat */
    int64_t tick;                          /* newest; -1 before the first */
    double impedance_nspm, rendered_npm;   /* of the line; of the object's spring */
    double position_m[COGRIP_AXES], velocity_mps[COGRIP_AXES], force_n[COGRIP_AXES];
    double object_m[COGRIP_AXES], object_mps[COGRIP_AXES];
    double rtt_ms;                                /* newest; nan before the first */
    double playout_frames;                        /* delay of the jitter buffer */
    double down_margin_j, device_margin_j;        /* least, so far (SPEC.md 9) */
    double up_margin_j, line_margin_j;            /* by the server's account, once it has said goodbye */
    double peak_force_n, peak_step_n;             /* largest force, and change of it from tick to tick */
    double gain;                                  /* share of the force that is let through: ramped from 0 to 1 and back */
    cogrip_link_count down;
    char room[161], user[161];
} cogrip_status;

/* ---- Core -------------------------------------------------------------------------------------- */

/* Make a client in `memory` of COGRIP_CLIENT_BYTES, aligned as malloc aligns; config_bytes: sizeof (cogrip_config). NULL, and
 * why in `error`, where it cannot be. */
COGRIP_API cogrip_client *cogrip_init(
    void *memory, size_t bytes, const cogrip_config *config, size_t config_bytes, char *error, size_t error_bytes);

/* Ask for a seat. */
COGRIP_API void cogrip_connect(cogrip_client *client, int64_t now_ns);

/* Take in one message: an unencrypted datagram, or what a DTLS record held. */
COGRIP_API void cogrip_receive(cogrip_client *client, const void *message, size_t bytes, int64_t now_ns);

/* Let time pass while there are no ticks yet, or none any more. Ticks do so by themselves. */
COGRIP_API void cogrip_poll(cogrip_client *client, int64_t now_ns);

/* First half of a tick, once seated: enter where the hand is. `tick` counts periods of status.device_hz from 0 on; those that
 * the loop missed are left out. position_m: one number an axis of the seat, NULL for no sample; velocity_mps: NULL to have it
 * estimated. */
COGRIP_API void cogrip_sense(
    cogrip_client *client, int64_t tick, const double *position_m, const double *velocity_mps, int64_t now_ns);

/* Second half: the force to hold until the next tick, in force_n[COGRIP_AXES]. Always finite, and within the config's
 * bounds. */
COGRIP_API void cogrip_act(cogrip_client *client, double *force_n, int64_t now_ns);

/* Next datagram to send, in buffer[COGRIP_MESSAGE_BYTES]: its length, 0 for none. *hello: it goes by the newest path (SPEC.md
 * 4.4). */
COGRIP_API size_t cogrip_next(cogrip_client *client, void *buffer, int *hello);

/* Buttons that are down (bit k: button k + 1), the handle's quaternion w, x, y, z or NULL, and its grip or nan: before
 * cogrip_sense. */
COGRIP_API void cogrip_handle(cogrip_client *client, uint32_t buttons, const double *orientation, double grip_m);

/* Release hand and object, then leave. Go on with ticks until cogrip_done: the force fades, the server answers. */
COGRIP_API void cogrip_leave(cogrip_client *client, const char *reason, int64_t now_ns);

/* End a fault. The force ramps in from zero. */
COGRIP_API void cogrip_rearm(cogrip_client *client);

/* True once the session is over and no force is left. */
COGRIP_API int cogrip_done(const cogrip_client *client);

/* status_bytes: sizeof (cogrip_status). What the library does not know of it is 0. */
COGRIP_API void cogrip_get_status(const cogrip_client *client, cogrip_status *status, size_t status_bytes);

/* Why the session ended badly, or the force is released; "" for neither. */
COGRIP_API const char *cogrip_reason(const cogrip_client *client);
COGRIP_API uint64_t cogrip_count(const cogrip_client *client, int which);
COGRIP_API const char *cogrip_count_name(int which);

/* ---- Join links (SPEC.md 12) ----------------------------------------------------------------- */

typedef struct cogrip_target {
    char host[300], room[41], token[641], fingerprint[65]; /* fingerprint "": unencrypted */
    int port;
} cogrip_target;

/* Read a join link, or HOST:PORT of an unencrypted server. 0, and why in `error`, where it is neither; a link's secret is
 * never shown. target_bytes: sizeof (cogrip_target). */
COGRIP_API int cogrip_parse_target(
    const char *text, cogrip_target *target, size_t target_bytes, char *error, size_t error_bytes);

/* ---- Driver: UDP, DTLS and a clock. POSIX ---------------------------------------------------- */

#ifndef COGRIP_NO_DRIVER
#define COGRIP_DRIVER_BYTES (COGRIP_CLIENT_BYTES + 16384) /* memory of a driver, its client's included */

typedef struct cogrip_driver cogrip_driver;

COGRIP_API size_t cogrip_driver_bytes(void); /* of the library that is linked */

/* Look the server up, open a socket and begin to ask for a seat. `config`: nonce is drawn here; token and room are the link's.
 * allow_unencrypted: a person has allowed to talk to another machine unencrypted. NULL, and why in `error`, where it cannot
 * be. */
COGRIP_API cogrip_driver *cogrip_open(
    void *memory, size_t bytes, const char *target, const cogrip_config *config, size_t config_bytes, int allow_unencrypted,
    char *error, size_t error_bytes);

/* Receive, let time pass and send: every few milliseconds until there is a seat. Returns the state. */
COGRIP_API cogrip_state cogrip_run(cogrip_driver *driver);

/* A whole tick: sense, send, receive, act. Never blocks. */
COGRIP_API void cogrip_tick(
    cogrip_driver *driver, int64_t tick, const double *position_m, const double *velocity_mps, double *force_n);

COGRIP_API cogrip_client *cogrip_client_of(cogrip_driver *driver);
COGRIP_API void cogrip_driver_leave(cogrip_driver *driver, const char *reason);
COGRIP_API void cogrip_close(cogrip_driver *driver); /* closes the sockets; after cogrip_done, or to give up at once */
COGRIP_API int64_t cogrip_now_ns(void);              /* monotonic clock */

/* Sleep until that clock shows due_ns, or a signal comes: returns what it shows then. */
COGRIP_API int64_t cogrip_sleep_until(int64_t due_ns);
#endif

#ifdef __cplusplus
}
#endif
#endif
