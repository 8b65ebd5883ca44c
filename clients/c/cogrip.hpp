/* The client of cogrip.h for C++17: a seat that closes itself, errors as exceptions, and the time of ticks. Header alone:
 * link libcogrip, or compile cogrip.c beside it.
 *
 * Units, signs and the rule of one thread at a time are those of cogrip.h. A tick neither allocates nor throws.
 */
#ifndef COGRIP_HPP
#define COGRIP_HPP

#include "cogrip.h"

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <utility>

#include <pthread.h>
#include <sched.h>

namespace cogrip {

/* A place, a velocity or a force: x toward the user, y to the user's right, z up. Axes that a seat has not are 0. */
using vector = std::array<double, COGRIP_AXES>;

/* A seat that cannot be had: what() says why in one line. */
class error : public std::runtime_error {
public:
    using std::runtime_error::runtime_error;
};

/* What a hand is held with: the fields of cogrip_config. Those without a value must be given. */
struct options {
    std::string room, name, token, device = "c++", software = "c++";
    int axes = COGRIP_AXES;
    double rate_hz = 1024.0;
    double peak_force_n = 0.0;
    double speed_mps = 0.0;
    double slew_nps = 0.0;
    double apparent_mass_kg = 0.0;
    double damping_nspm = 0.0;
    double carried_nspm = 0.0;
    bool allow_unencrypted = false; /* a person has allowed to talk to another machine unencrypted */
};

/* One person's seat at the object of a server's room. */
class seat {
public:
    /* Begin to ask for a seat. `target`: a join link, or HOST:PORT of an unencrypted server. */
    seat(const std::string &target, const options &given) {
        if (cogrip_abi() != COGRIP_ABI)
            throw error("libcogrip: its ABI is " + std::to_string(cogrip_abi()) + ", this program was compiled for "
                + std::to_string(COGRIP_ABI) + "; install the libcogrip that it was compiled with");
        cogrip_config config{};
        config.room = given.room.c_str();
        config.name = given.name.c_str();
        config.token = given.token.c_str();
        config.device = given.device.c_str();
        config.software = given.software.c_str();
        config.axes = given.axes;
        config.rate_hz = given.rate_hz;
        config.peak_force_n = given.peak_force_n;
        config.speed_mps = given.speed_mps;
        config.slew_nps = given.slew_nps;
        config.apparent_mass_kg = given.apparent_mass_kg;
        config.damping_nspm = given.damping_nspm;
        config.carried_nspm = given.carried_nspm;
        char why[256];
        memory_.reset(::operator new(cogrip_driver_bytes()));
        driver_ = cogrip_open(memory_.get(), cogrip_driver_bytes(), target.c_str(), &config, sizeof config,
            given.allow_unencrypted, why, sizeof why);
        if (!driver_) throw error(why);
    }

    seat(seat &&other) noexcept
        : memory_(std::move(other.memory_)), driver_(std::exchange(other.driver_, nullptr)) {}

    seat &operator=(seat &&other) noexcept {
        std::swap(memory_, other.memory_);
        std::swap(driver_, other.driver_);
        return *this;
    }

    /* Closes the sockets: leave() and ticks until done() come before, or the server notices the silence. */
    ~seat() {
        if (driver_) cogrip_close(driver_);
    }

    /* Receive, let time pass and send: every few milliseconds until there is a seat, or none can be had. */
    cogrip_state run() noexcept { return cogrip_run(driver_); }

    /* Wait until the seat is taken. Throws where the server refuses, or does not answer for 3 s. */
    void wait_until_seated() {
        for (cogrip_state state = run(); state != COGRIP_SEATED; state = run()) {
            if (state == COGRIP_CLOSED) throw error(reason());
            cogrip_sleep_until(cogrip_now_ns() + 2'000'000);
        }
    }

    /* A whole tick. Returns the force to hold until the next: the motors push the hand with minus that. */
    vector tick(std::int64_t number, const vector &position_m) noexcept { return act(number, position_m.data(), nullptr); }
    vector tick(std::int64_t number, const vector &position_m, const vector &velocity_mps) noexcept {
        return act(number, position_m.data(), velocity_mps.data());
    }

    /* A tick in which the device gave no sample. */
    vector tick(std::int64_t number) noexcept { return act(number, nullptr, nullptr); }

    /* Buttons that are down (bit k: button k + 1), before tick(). */
    void buttons(std::uint32_t down) noexcept { cogrip_handle(client(), down, nullptr, not_given); }

    /* Release hand and object, then leave: go on with ticks until done(). */
    void leave(const std::string &why) noexcept { cogrip_driver_leave(driver_, why.c_str()); }
    bool done() const noexcept { return cogrip_done(client()) != 0; }

    /* End a fault. The force ramps in from zero. */
    void rearm() noexcept { cogrip_rearm(client()); }

    cogrip_status status() const noexcept {
        cogrip_status now;
        cogrip_get_status(client(), &now, sizeof now);
        return now;
    }

    /* Why the session ended badly, or the force is released; "" for neither. */
    std::string reason() const { return cogrip_reason(client()); }

    /* The C client itself, for what is not here. */
    cogrip_client *client() const noexcept { return cogrip_client_of(driver_); }

private:
    struct release {
        void operator()(void *memory) const noexcept { ::operator delete(memory); }
    };
    static constexpr double not_given = std::numeric_limits<double>::quiet_NaN();

    vector act(std::int64_t number, const double *position_m, const double *velocity_mps) noexcept {
        vector force_n{};
        cogrip_tick(driver_, number, position_m, velocity_mps, force_n.data());
        return force_n;
    }

    std::unique_ptr<void, release> memory_;
    cogrip_driver *driver_ = nullptr;
};

/* The times of a seat's ticks, from now on. */
class pacer {
public:
    explicit pacer(int hz) noexcept : begun_ns_(cogrip_now_ns()), hz_(hz) {}

    /* Sleep until the next tick is due. Returns its number: ticks that the loop missed are left out. */
    std::int64_t wait() noexcept {
        const std::int64_t elapsed_ns = cogrip_now_ns() - begun_ns_, passed = elapsed_ns / second_ns * hz_
            + elapsed_ns % second_ns * hz_ / second_ns;
        tick_ = passed > tick_ ? passed : tick_ + 1;
        const std::int64_t due_ns = begun_ns_ + tick_ / hz_ * second_ns + tick_ % hz_ * second_ns / hz_;
        while (cogrip_sleep_until(due_ns) < due_ns) continue;
        return tick_;
    }

private:
    static constexpr std::int64_t second_ns = 1'000'000'000;
    std::int64_t begun_ns_, hz_, tick_ = -1;
};

/* Ask for the calling thread's ticks on time (SCHED_FIFO). False where this user may not: they may then be late. */
inline bool ask_for_real_time() noexcept {
    sched_param priority{};
    priority.sched_priority = 20;
    return !pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority);
}

} // namespace cogrip
#endif
