/* The parts of cogrip.c that no caller sees, for tests to call one by one. */
#include "cogrip.c"

static decoded found;

/* Decode a message. Returns its tag, 0 where it is malformed. */
int probe_decode(const void *data, size_t bytes) {
    decode(data, bytes, &found);
    return found.tag;
}

/* Fields of the message decoded last, as JSON. */
void probe_fields(char *into, size_t size) {
    const settings *seat = &found.as.welcome.seat;
    const waves *sent = &found.as.waves;
    int used;
    switch (found.tag) {
    case TAG_WELCOME:
        snprintf(into, size,
            "{\"nonce\": %lld, \"session\": %lld, \"ticket\": \"%s\", \"player\": %d, \"room\": \"%s\", \"user\": \"%s\", "
            "\"seat\": %d, "
            "\"device_hz\": %d, \"network_hz\": %d, \"axes\": %d, \"automatic\": %d, \"frames\": %d, \"redundancy\": %d, "
            "\"emulated\": %d, "
            "\"impedance_nspm\": %.17g, \"rendered_npm\": %.17g, \"late\": %.17g, \"tank_mj\": %.17g, "
            "\"wave_filter_hz\": %.17g, "
            "\"kind\": \"%s\", \"decimator\": \"%s\", \"concealment\": \"%s\"}",
            (long long)found.as.welcome.nonce, (long long)found.as.welcome.session, found.as.welcome.ticket,
                found.as.welcome.player,
            seat->room, seat->user, seat->seat, seat->device_hz, seat->network_hz, seat->axes, seat->automatic,
                seat->playout_frames,
            seat->redundancy, seat->emulated, seat->impedance_nspm, seat->rendered_npm, seat->late, seat->tank_mj,
                seat->wave_filter_hz,
            seat->kind, decimators[seat->decimator], concealments[seat->concealment]);
        break;
    case TAG_REFUSE:
        snprintf(into, size, "{\"nonce\": %lld, \"code\": \"%s\", \"reason\": \"%s\"}", (long long)found.as.refusal.nonce,
            found.as.refusal.code, found.as.refusal.reason);
        break;
    case TAG_WAVES:
        used = snprintf(into, size,
            "{\"session\": %lld, \"first\": %lld, \"made_j\": %.17g, \"port_j\": %.17g, \"acknowledged\": %lld, "
            "\"sent_ns\": %lld, "
            "\"echo_ns\": %lld, \"held_ns\": %lld, \"phase\": %lld, \"applied\": %lld, \"impedance_nspm\": %.17g, "
            "\"since\": %lld, "
            "\"edges\": %lld, \"total\": %.17g, \"squares\": %.17g, \"state\": %.17g, \"waves\": [",
            (long long)sent->session, (long long)sent->first, sent->made_j, sent->port_j, (long long)sent->acknowledged,
            (long long)sent->sent.sent_ns, (long long)sent->sent.echo_ns, (long long)sent->sent.held_ns, (long long)sent->phase,
            (long long)sent->applied, sent->impedance_nspm, (long long)sent->since, (long long)sent->edges, sent->total[0],
            sent->squares[0], sent->state[1]);
        for (int place = 0; place < sent->count; place++)
            used += snprintf(into + used, size - (size_t)used, "%s%.17g", place ? ", " : "", sent->wave[place]);
        snprintf(into + used, size - (size_t)used, "]}");
        break;
    case TAG_FAREWELL:
        snprintf(into, size, "{\"session\": %lld, \"reason\": \"%s\", \"up_margin_j\": %.17g, \"line_margin_j\": %.17g}",
            (long long)found.as.farewell.session, found.as.farewell.reason, found.as.farewell.up_margin_j,
                found.as.farewell.line_margin_j);
        break;
    case TAG_EFFECTS: {
        const told_effects *told = &found.as.effects;
        const effect *given = &told->effect;
        snprintf(into, size,
            "{\"session\": %lld, \"version\": %lld, \"tank_mj\": %.17g, \"number\": %lld, \"count\": %d, \"kind\": \"%s\", "
            "\"place_m\": [%.17g, %.17g, %.17g], \"direction\": [%.17g, %.17g, %.17g], \"stiffness_npm\": %.17g, "
            "\"damping_nspm\": %.17g}",
            (long long)told->session, (long long)told->version, told->tank_mj, (long long)told->number, told->count,
            effect_kinds[given->kind], given->place_m[0], given->place_m[1], given->place_m[2], given->direction[0],
            given->direction[1], given->direction[2], given->number[STIFFNESS_NPM], given->number[DAMPING_NSPM]);
        break;
    }
    case TAG_PARTNER: {
        const told_partners *told = &found.as.partners;
        const intent *one = &told->intents[0];
        snprintf(into, size,
            "{\"session\": %lld, \"number\": %lld, \"acknowledged\": %lld, \"sent_ns\": %lld, \"echo_ns\": %lld, "
            "\"held_ns\": %lld, \"edges\": %lld, \"port_j\": %.17g, \"rows\": [%.17g, %.17g], "
            "\"intent\": [%d, %lld, [%.17g], [%.17g], %.17g, %.17g], \"count\": %d}",
            (long long)told->session, (long long)told->number, (long long)told->acknowledged, (long long)told->sent.sent_ns,
            (long long)told->sent.echo_ns, (long long)told->sent.held_ns, (long long)told->edges, told->port_j,
            told->position_m[0], told->velocity_mps[0], one->seat, (long long)one->made_ns, one->place_m[0], one->rate_mps[0],
            one->stiffness_npm, one->donated_j, told->count);
        break;
    }
    case TAG_HEARTBEAT:
        snprintf(into, size, "{\"session\": %lld, \"sent_ns\": %lld, \"echo_ns\": %lld, \"held_ns\": %lld}",
            (long long)found.as.heartbeat.session, (long long)found.as.heartbeat.sent.sent_ns,
            (long long)found.as.heartbeat.sent.echo_ns, (long long)found.as.heartbeat.sent.held_ns);
        break;
    default: snprintf(into, size, "{}");
    }
}

static size_t given(const message *from, void *into) {
    memcpy(into, from->data, from->bytes);
    return from->bytes;
}

size_t probe_heartbeat(int64_t session, int64_t now_ns, void *into) {
    static cogrip_client client;
    message out;
    memset(&client, 0, sizeof client);
    client.seat.session = session;
    write_heartbeat(&client, &out, now_ns);
    return given(&out, into);
}

/* The leave of the page, with its account or without. */
size_t probe_leave(int64_t session, int with_account, void *into) {
    static const double row[][4] =
        {{10.5, 12.0, 12.5, 13.0}, {4.0, 5.5, 6.0, 6.5}, {6.5, 7.0, 7.25, 7.5}, {0.5, 1.0, 1.5, 2.0}};
    static const double line_values[] = {5.5, 5.5, 20.0, 0.5, 0.0, 0.5};
    static const cogrip_link_count down = {640, 636, 630, 4, 6, 1, 2};
    account report;
    message out;
    memset(&report, 0, sizeof report);
    report.axes = 1;
    report.position_m[0] = 0.015625, report.force_n[0] = 1.25, report.peak_force_n = 2.5, report.travel_m = 0.25;
    report.felt_npm = NAN, report.predicted_npm = 630.5, report.down_margin_j = 0.0, report.leak_j = -0.0009765625;
    report.down = down;
    memcpy(report.rtt_ms, row[0], sizeof row[0]);
    memcpy(report.up_ms, row[1], sizeof row[1]);
    memcpy(report.down_ms, row[2], sizeof row[2]);
    memcpy(report.late_us, row[3], sizeof row[3]);
    for (int place = 0; place < 4; place++) report.work_us[place] = NAN;
    report.offset_ms = -1536.0, report.uncertainty_ms = 5.0, report.ticks_due = 5120, report.ticks_run = 5119;
    report.repeated = 3, report.skipped = 2, report.concealed = 10, report.longest_gap = 5;
    copy_text(report.state, sizeof report.state, "live");
    report.peak_step_n = 0.625, report.depth_frames = 2.5, report.least_frames = 1.0, report.most_frames = 4.0;
    report.oscillates = 1, report.at_limit = 0.0625, report.controlled = 0.03125, report.port_leak_j = 0.00048828125;
    report.port_margin_j = 0.0009765625, report.let_go = 2, report.port_reserve_j = 0.25, report.port_budget_j = 0.5;
    report.port_shake_n = 0.03125, report.down_reserve_j = 0.0078125;
    memcpy(report.line, line_values, sizeof line_values);
    write_leave(&out, session, "done", with_account ? &report : NULL);
    return given(&out, into);
}

/* The partner of the page, as a client writes it. */
size_t probe_partner(int64_t session, void *into) {
    static cogrip_client client;
    message out;
    memset(&client, 0, sizeof client);
    client.seat.session = session, client.axes = 1, client.seat.seat.seat = 1, client.line.up.next = 301;
    client.position_m[0] = 0.015625, client.velocity_mps[0] = -0.125, client.partners.down.last_number = 298;
    client.clock.known = 1, client.clock.peer_sent_ns = 999000000, client.clock.received_ns = 998500000;
    client.partners.held = 1, client.partners.hold = 1.0, client.partners.here_s = 1.0;
    client.partners.own.place_m[0] = 0.03125, client.partners.own.rate_mps[0] = -0.125;
    client.partners.gate.donated_j = 0.0625, client.partners.gate.credited_j = 0.03125 + 0.0625;
    write_partners(&client, &out, 1000000000);
    return given(&out, into);
}

size_t probe_client_bytes(void) { return sizeof(cogrip_client); }

/* ---- One line of one axis ---- */

static sender line_sender;
static receiver line_receiver;
static waves contents;

void probe_line(int frames, int redundancy, int ticks, double late, double credit_j, int concealment) {
    settings seat;
    memset(&seat, 0, sizeof seat);
    seat.automatic = frames < 0, seat.playout_frames = frames, seat.late = late, seat.tank_mj = 1e3 * credit_j;
    seat.network_hz = 128, seat.device_hz = 128 * ticks, seat.concealment = concealment;
    memset(&line_sender, 0, sizeof line_sender);
    line_sender.axes = 1, line_sender.redundancy = redundancy;
    receiver_init(&line_receiver, &seat, 1);
}

void probe_push(double wave) { sender_push(&line_sender, &wave); }

/* What the next datagram carries. Returns the number of its waves. */
int probe_contents(int64_t *first, double *wave, double *total, double *squares) {
    const int frames = sender_frames(&line_sender);
    *first = line_sender.next - frames;
    for (int place = 0; place < frames; place++) wave[place] = line_sender.wave[(*first + place) % line_sender.redundancy][0];
    *total = line_sender.total[0].value;
    *squares = line_sender.squares[0].value;
    return frames;
}

int probe_take(int64_t first, int count, const double *wave, double total, double squares, int64_t early) {
    memset(&contents, 0, sizeof contents);
    contents.first = first, contents.count = count, contents.totals = contents.squares_count = 1;
    memcpy(contents.wave, wave, sizeof *wave * (size_t)count);
    contents.total[0] = total, contents.squares[0] = squares;
    return receiver_take(&line_receiver, &contents, early);
}

double probe_pop(void) {
    double wave[AXES];
    receiver_pop(&line_receiver, wave);
    return wave[0];
}

/* hold, played, cursor, repeated, skipped, then sent, received, applied, lost, late, duplicate, pending. */
void probe_state(int64_t *into) {
    cogrip_link_count count;
    receiver_count(&line_receiver, &count);
    const int64_t values[] = {line_receiver.hold, line_receiver.played, line_receiver.cursor, line_receiver.buffer.repeated,
        line_receiver.buffer.skipped, count.sent, count.received, count.applied, count.lost, count.late, count.duplicate,
            count.pending};
    memcpy(into, values, sizeof values);
}

/* Credit of a client's line down [W]. */
double probe_credit_of(const cogrip_client *client) { return client->line.down.energy.credit; }

double probe_credit(void) { return line_receiver.energy.credit; }

/* Energy [J] of the frame that ends after `ticks` ticks of the wave u, of which the port has `spare_j` to spare;
 * *withheld: the sum of what waits. */
double probe_end_frame(double u, int ticks, int fresh, double spare_j, double *withheld) {
    static cogrip_client client;
    if (fresh) {
        memset(&client, 0, sizeof client);
        client.axes = client.line.up.axes = 1, client.line.up.redundancy = 1,
        client.ticks_per_frame = 8, client.tick_s = 1.0 / 1024;
    }
    client.line.shift = ticks - 8;
    client.line.decimated[0] = ticks * u;
    client.line.made_now_j = 0.5 * client.tick_s * ticks * u * u;
    line_end_frame(&client, spare_j);
    *withheld = client.line.withheld[0];
    const double sent = client.line.up.wave[0][0];
    return 0.5 / 128 * sent * sent;
}

/* Force [N] that the device port leaves of one, at 1 m/s and 1024 Hz, with a reserve for fading of 0.1 J. */
double probe_port_limit(double force, double balance_j) {
    static cogrip_client client;
    memset(&client, 0, sizeof client);
    client.axes = 1, client.tick_s = 1.0 / 1024, client.config.speed_mps = 1.0;
    client.faded_j = 0.1, client.balance_j = balance_j;
    port_limit(&client, &force);
    return force;
}

/* ---- Effects ---- */

static effects rendered;

/* numbers: tick [s], impedance that the device carries, its lag [s], the coupling's part, speed, slope, most of the tank. */
void probe_effects(int axes, const double *numbers) {
    memset(&rendered, 0, sizeof rendered);
    effects_fit(&rendered, axes, numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6]);
}

/* Take in a message. Returns the count that it raises, -1 for none, -2 where it is malformed. */
int probe_effects_tell(const void *data, size_t bytes, int64_t tick) {
    return probe_decode(data, bytes) == TAG_EFFECTS ? effects_tell(&rendered, &found.as.effects, tick) : -2;
}

int probe_effects_know(int64_t number) { return effects_know(&rendered, number); }

/* One tick: the hand's way, start and end, against `held_n`; then the law of the coupling, to which the effects' is added.
 * gain below 0: there is no law; then out[0] is the law, out[3] on: level, least, drawn, overdrawn, work, stored, less_ticks,
 * reduced. */
void probe_effects_tick(int64_t tick, const double *held_n, const double *start_m, const double *end_m,
    const double *velocity_mps, double gain, const double *coupling_n, double *out) {
    effects_enter(&rendered, held_n, start_m, end_m);
    memset(out, 0, sizeof *out * AXES);
    if (gain < 0.0) {
        effects_begin_anew(&rendered);
    } else {
        effects_step(&rendered, tick, end_m, velocity_mps, gain);
        for (int axis = 0; axis < rendered.axes; axis++) {
            out[axis] = rendered.asked ? rendered.asked_n[axis] : 0.0;
            rendered.law_n[axis] = coupling_n[axis] + out[axis];
        }
    }
    const double state[] = {rendered.level_j, rendered.least_level_j, rendered.drawn_j, rendered.overdrawn_j,
        rendered.work_j, rendered.stored_j, (double)rendered.less_ticks, rendered.reduced};
    memcpy(out + AXES, state, sizeof state);
}

void probe_effects_forget(void) { effects_forget(&rendered); }

/* ---- Models of partners ---- */

static gate own_gate;
static intention own_intention;

void probe_gate_begin(double tick_s) { gate_init(&own_gate, tick_s); }

/* Part of the stretch that one tick of the gate leaves; it reduces the damper's force. state: b, Don, Refill, Spill. */
double probe_gate_tick(int axes, double work_j, double credit_j, double *stretch_m, double stiffness_npm, double *damper_n,
    const double *velocity_mps, double damping_nspm, double *state) {
    add(&own_gate.work, work_j);
    own_gate.coming_j += credit_j;
    const double part = gate_cut(&own_gate, stretch_m, axes, stiffness_npm);
    for (int axis = 0; axis < axes; axis++) stretch_m[axis] *= part;
    gate_pay(&own_gate, stretch_m, stiffness_npm, damper_n, velocity_mps, damping_nspm, axes);
    const double found_j[] = {gate_budget_j(&own_gate), own_gate.donated_j, own_gate.refilled_j, own_gate.spilt_j};
    memcpy(state, found_j, sizeof found_j);
    return part;
}

/* One tick of the intention; out: its place on all axes, then its rate. */
void probe_intention(int begin, int axes, const double *position_m, const double *velocity_mps, const double *force_n,
    double mass_kg, double tick_s, double *out) {
    if (begin) intention_begin(&own_intention, position_m, axes);
    intention_update(&own_intention, position_m, velocity_mps, force_n, mass_kg, tick_s, axes);
    memcpy(out, own_intention.place_m, sizeof *out * (size_t)axes);
    memcpy(out + axes, own_intention.rate_mps, sizeof *out * (size_t)axes);
}

/* One tick of a copy on one axis. motion: its place and velocity; numbers: mass, damping, K, B, tick; own: the hand;
 * models: of each place, velocity, intention, stiffness and drift. */
void probe_step_copy(double *motion, const double *numbers, const double *own, int count, double *models) {
    partner known[MOST_PARTNERS];
    memset(known, 0, sizeof known);
    for (int place = 0; place < count; place++) {
        const double *row = &models[5 * place];
        known[place].told.axes = 1, known[place].age_s = LATE_S;
        known[place].place_m[0] = row[0], known[place].velocity_mps[0] = row[1];
        known[place].intention_m[0] = row[2], known[place].stiffness_npm = row[3];
        known[place].drift_mps[0] = row[4];
    }
    step_copy(0, numbers[4], &motion[0], &motion[1], numbers[0], numbers[1], numbers[2], numbers[3], known, count, own);
    for (int place = 0; place < count; place++)
        models[5 * place] = known[place].place_m[0], models[5 * place + 1] = known[place].velocity_mps[0];
}

/* What the gate of a client has in its ledger: W, Don, Cred, Refill. */
void probe_gate_of(const cogrip_client *client, double *into) {
    const gate *own = &client->partners.gate;
    const double found_j[] = {own->work.value, own->donated_j, own->credited_j, own->refilled_j};
    memcpy(into, found_j, sizeof found_j);
}
