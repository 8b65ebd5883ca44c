/* Feeds mutated datagrams to a client between its ticks:  fuzz CORPUS COUNT SEED.  CORPUS: datagrams, each behind its length
 * in two bytes.
 *
 * Ends with 1 where a force breaks a limit; the sanitizers end it where memory or arithmetic is misused. */
#include "cogrip.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_ITEMS = 4096, LIFE = 2000 };

static struct {
    unsigned char data[2048];
    size_t bytes;
} corpus[MOST_ITEMS];
static size_t items;
static uint64_t state;

static uint64_t next_random(void) { /* xorshift64* */
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return state * UINT64_C(2685821657736338717);
}

static size_t below(size_t bound) { return (size_t)(next_random() % bound); }

static size_t mutate(unsigned char *data, size_t bytes, size_t room) {
    static const unsigned char interesting[] =
        {0x00, 0x01, 0x7f, 0x80, 0x8f, 0x90, 0x9f, 0xa0, 0xc0, 0xc1, 0xc3, 0xc6, 0xca, 0xcb, 0xcf, 0xd3, 0xdb, 0xdc, 0xdd,
            0xdf, 0xff};
    for (size_t times = 1 + below(4); times; times--) {
        const size_t at = bytes ? below(bytes) : 0;
        switch (below(7)) {
        case 0: if (bytes) data[at] ^= (unsigned char)(1U << below(8)); break;
        case 1: if (bytes) data[at] = interesting[below(sizeof interesting)]; break;
        case 2: if (bytes) bytes = at; break;
        case 3: /* insert */
            if (bytes + 1 < room) {
                memmove(data + at + 1, data + at, bytes - at);
                data[at] = (unsigned char)next_random();
                bytes++;
            }
            break;
        case 4: /* leave out */
            if (bytes) memmove(data + at, data + at + 1, --bytes - at);
            break;
        case 5: /* go on as another does */
            if (items) {
                const size_t other = below(items), rest = corpus[other].bytes > at ? corpus[other].bytes - at : 0;
                if (rest && at + rest < room) {
                    memcpy(data + at, corpus[other].data + at, rest);
                    bytes = at + rest;
                }
            }
            break;
        default: /* another number */
            for (size_t place = at; place < bytes && place < at + 8; place++) data[place] = (unsigned char)next_random();
        }
    }
    return bytes;
}

static int limits_hold(const double *force_n, const double *before_n) {
    for (int axis = 0; axis < COGRIP_AXES; axis++)
        if (!(fabs(force_n[axis]) <= 8.0 * (1.0 + 1e-12)) || !(fabs(force_n[axis] - before_n[axis]) <= 1000.0 / 256.0))
            return 0;
    return 1;
}

int main(int count, char **arguments) {
    FILE *file = count == 4 ? fopen(arguments[1], "rb") : NULL;
    unsigned char head[2];
    if (!file) return 2;
    while (items < MOST_ITEMS && fread(head, 1, 2, file) == 2) {
        corpus[items].bytes = (size_t)(head[0] | head[1] << 8);
        if (corpus[items].bytes > sizeof corpus[0].data
            || fread(corpus[items].data, 1, corpus[items].bytes, file) != corpus[items].bytes) return 2;
        items++;
    }
    fclose(file);
    state = strtoull(arguments[3], NULL, 10) * 2 + 1;
    const long wanted = strtol(arguments[2], NULL, 10);
    unsigned char *memory = malloc(COGRIP_CLIENT_BYTES);
    cogrip_client *client = NULL;
    cogrip_config config = {0};
    double force_n[COGRIP_AXES] = {0.0}, before_n[COGRIP_AXES];
    unsigned long long malformed = 0, applied = 0, late = 0;
    int64_t now_ns = 0, tick = 0;
    config.nonce = 40, config.axes = 3, config.rate_hz = 4096.0, config.peak_force_n = 8.0, config.speed_mps = 2.0;
    for (long done = 0; done < wanted; done++) {
        if (done % LIFE == 0) {
            cogrip_status status;
            if (client) {
                cogrip_get_status(client, &status, sizeof status);
                malformed += cogrip_count(client, COGRIP_MALFORMED);
                applied += (unsigned long long)status.down.received;
                late += cogrip_count(client, COGRIP_LATE_EFFECTS);
            }
            client = cogrip_init(memory, COGRIP_CLIENT_BYTES, &config, sizeof config, NULL, 0);
            if (!client) return 2;
            memset(force_n, 0, sizeof force_n);
            now_ns = tick = 0;
            cogrip_connect(client, now_ns);
            if (below(8)) cogrip_receive(client, corpus[0].data, corpus[0].bytes, now_ns); /* a welcome */
        }
        /* A buffer of just its size: a byte read beyond is an error. */
        unsigned char whole[2048];
        const size_t chosen = below(4) ? below(items) : (size_t)(done % LIFE) % items;
        memcpy(whole, corpus[chosen].data, corpus[chosen].bytes);
        const size_t bytes = mutate(whole, corpus[chosen].bytes, sizeof whole);
        unsigned char *datagram = malloc(bytes ? bytes : 1);
        memcpy(datagram, whole, bytes);
        cogrip_receive(client, datagram, bytes, now_ns);
        free(datagram);
        if (below(3) == 0) { /* one as it was sent keeps the session going */
            const size_t honest = (size_t)(done % LIFE) % items;
            cogrip_receive(client, corpus[honest].data, corpus[honest].bytes, now_ns);
        }
        for (size_t ticks = below(3); ticks; ticks--) {
            double place[COGRIP_AXES] = {0.02 * sin(1e-2 * (double)tick), 0.0, 0.0};
            if (!below(2000)) place[below(COGRIP_AXES)] = below(2) ? NAN : 1e308;
            tick += below(500) ? 1 : (int64_t)below(300);
            now_ns += (int64_t)(below(1000) ? 976562 : below(4000000000U));
            memcpy(before_n, force_n, sizeof before_n);
            cogrip_handle(client, (uint32_t)(below(4) ? 0 : next_random()), NULL, NAN);
            cogrip_sense(client, tick, below(100) ? place : NULL, NULL, now_ns);
            cogrip_act(client, force_n, now_ns);
            if (!limits_hold(force_n, before_n)) {
                fprintf(stderr, "a force breaks a limit: %g after %g\n", force_n[0], before_n[0]);
                return 1;
            }
            if (!below(300)) cogrip_rearm(client);
            if (!below(3000)) cogrip_leave(client, "fuzzed", now_ns);
        }
        unsigned char out[COGRIP_MESSAGE_BYTES];
        while (cogrip_next(client, out, NULL)) continue;
        if (done % 16 == 0) {
            static const char link[] =
                "cogrip://[fe80::1%25eth0]:47800/lab%20b"
                "#0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef.AAECAwQFBgcICQoLDA0ODw";
            cogrip_target target;
            memcpy(whole, link, sizeof link);
            whole[mutate(whole, sizeof link - 1, sizeof whole - 1)] = '\0';
            cogrip_parse_target((const char *)whole, &target, sizeof target, NULL, 0);
        }
    }
    printf("%ld mutated, %llu malformed, %llu frames taken, %llu effects late\n", wanted, malformed, applied, late);
    free(memory);
    return 0;
}
