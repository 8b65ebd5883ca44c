/* Holds the object of a running server with a haptic device that CHAI3D knows.
 *
 *     ./chai3d_join --list
 *     ./chai3d_join TARGET [--device N] [--name NAME] [--seconds S] [--peak-n N] [--speed-mps V] [--mass-kg M]
 *         [--carried-nspm B]
 *
 * TARGET: a join link, HOST:PORT of an unencrypted server, or - to read it from standard input. Ctrl-C leaves, SIGUSR1 re-arms.
 * Axes and units are the same in both: x toward the user, y to the right, z up, m and N.
 */
#include "cogrip.hpp"

#include "devices/CHapticDeviceHandler.h"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <exception>
#include <iostream>
#include <map>

namespace {

constexpr double default_peak_n = 3.0;       /* of no arm more unless it is asked for */
constexpr double default_carried_nspm = 5.0; /* the same, of damping */

volatile std::sig_atomic_t stopped, rearmed;

struct flags {
    std::string target;
    bool list = false;
    unsigned int device = 0;
    std::string name;
    double seconds = HUGE_VAL, peak_n = 0.0, speed_mps = 1.0, mass_kg = 0.1, carried_nspm = 0.0;
};

double number(const std::string &flag, const std::string &text) {
    std::size_t read = 0;
    double value = NAN;
    try {
        value = std::stod(text, &read);
    } catch (const std::exception &) {
        read = 0;
    }
    if (!read || read != text.size() || !(value >= 0.0) || !std::isfinite(value))
        throw cogrip::error(flag + " " + text + ": give a number of 0 or more");
    return value;
}

flags parse(int count, char **arguments) {
    flags given;
    const std::map<std::string, double *> numbers = {{"--seconds", &given.seconds}, {"--peak-n", &given.peak_n},
        {"--speed-mps", &given.speed_mps}, {"--mass-kg", &given.mass_kg}, {"--carried-nspm", &given.carried_nspm}};
    for (int at = 1; at < count; at++) {
        const std::string flag = arguments[at];
        if (flag == "--list") {
            given.list = true;
        } else if (flag.size() < 2 || flag[0] != '-') {
            if (!given.target.empty()) throw cogrip::error(flag + ": a second target; give one");
            given.target = flag;
        } else if (++at == count) {
            throw cogrip::error(flag + ": give a value after it");
        } else if (flag == "--name") {
            given.name = arguments[at];
        } else if (flag == "--device") {
            given.device = static_cast<unsigned int>(number(flag, arguments[at]));
        } else if (const auto found = numbers.find(flag); found != numbers.end()) {
            *found->second = number(flag, arguments[at]);
        } else {
            throw cogrip::error(flag
                + ": no such flag; there are --list, --device, --name, --seconds, --peak-n, --speed-mps, --mass-kg, "
                  "--carried-nspm");
        }
    }
    if (given.target == "-") std::getline(std::cin, given.target);
    if (!given.list && given.target.empty())
        throw cogrip::error("no target: give a join link, HOST:PORT, or - for standard input");
    return given;
}

/* What the seat is asked for with. CHAI3D's record is an estimate: of force no more than 3 N is taken by itself, of damping no
 * more than half of what it recommends and 5 N s/m. */
cogrip::options of(const chai3d::cHapticDeviceInfo &info, const flags &given) {
    if (!info.m_sensedPosition || !info.m_actuatedPosition)
        throw cogrip::error(info.m_modelName + ": it senses no place or has no motors; a haptic device is needed");
    if (given.peak_n > info.m_maxLinearForce)
        throw cogrip::error("--peak-n " + std::to_string(given.peak_n) + ": " + info.m_modelName + " gives "
            + std::to_string(info.m_maxLinearForce) + " N at most");
    cogrip::options options;
    options.name = given.name;
    options.device = "chai3d:" + info.m_modelName.substr(0, 100);
    options.software = "chai3d";
    options.peak_force_n = given.peak_n > 0.0 ? given.peak_n : std::min(info.m_maxLinearForce, default_peak_n);
    options.speed_mps = given.speed_mps;
    options.apparent_mass_kg = given.mass_kg;
    options.carried_nspm = given.carried_nspm > 0.0
        ? given.carried_nspm
        : std::clamp(0.5 * info.m_maxLinearDamping, 0.5, default_carried_nspm);
    return options;
}

/* A device that is open; its forces are off at the end, however it comes. */
class arm {
public:
    arm(chai3d::cGenericHapticDevicePtr device, const std::string &name) : device_(std::move(device)) {
        if (!device_->open()) throw cogrip::error(name + ": it does not open; is another program using it, may you?");
        push({});
        device_->calibrate();
        device_->enableForces(true);
    }
    arm(const arm &) = delete;
    arm &operator=(const arm &) = delete;
    ~arm() {
        push({});
        device_->enableForces(false);
        device_->close();
    }

    bool read(cogrip::vector &position_m) {
        chai3d::cVector3d place;
        if (!device_->getPosition(place)) return false;
        position_m = {place.x(), place.y(), place.z()};
        return true;
    }

    /* Push the hand with minus the force of cogrip, which resists motion. */
    bool push(const cogrip::vector &force_n) {
        return device_->setForce(chai3d::cVector3d(-force_n[0], -force_n[1], -force_n[2]));
    }

    std::uint32_t buttons() {
        unsigned int down = 0;
        return device_->getUserSwitches(down) ? down : 0;
    }

private:
    chai3d::cGenericHapticDevicePtr device_;
};

void report(const cogrip::seat &seat, std::int64_t absent) {
    const cogrip_status status = seat.status();
    std::printf("{\"ticks\": %lld, \"frames\": %lld, \"absent_samples\": %lld, \"peak_force_n\": %.3f, \"peak_step_n\": %.4f, "
                "\"object_m\": %.6f, \"down_margin_j\": %.3e, \"device_margin_j\": %.3e}\n",
        static_cast<long long>(status.tick), static_cast<long long>(status.down.applied), static_cast<long long>(absent),
        status.peak_force_n, status.peak_step_n, status.object_m[0], status.down_margin_j, status.device_margin_j);
}

/* Hold the object with an arm until the session is over. */
void hold(arm &arm, cogrip::seat &seat, double seconds) {
    const int hz = seat.status().device_hz;
    cogrip::pacer pacer(hz);
    cogrip::vector position_m{}, force_n{};
    cogrip_safety safety = COGRIP_RELEASED;
    bool pushed = true;
    std::int64_t absent = 0;
    while (!seat.done()) {
        const std::int64_t tick = pacer.wait();
        if (pushed && arm.read(position_m)) { /* an arm that takes no force is as bad as one that gives no place */
            seat.buttons(arm.buttons());
            force_n = seat.tick(tick, position_m); /* CHAI3D's velocity is older than the client's own estimate */
        } else {
            absent++;
            force_n = seat.tick(tick);
        }
        pushed = arm.push(force_n);
        if (stopped || static_cast<double>(tick) >= seconds * hz) seat.leave("its time is over");
        if (rearmed) {
            rearmed = 0;
            seat.rearm();
        }
        const cogrip_status status = seat.status();
        if (status.safety != safety && !seat.reason().empty()) std::cerr << "chai3d_join: " << seat.reason() << "\n";
        safety = status.safety;
    }
    report(seat, absent);
    if (!seat.reason().empty()) throw cogrip::error(seat.reason());
}

int run(const flags &given) {
    chai3d::cHapticDeviceHandler handler;
    chai3d::cHapticDeviceInfo info;
    if (given.list) {
        for (unsigned int number = 0; handler.getDeviceSpecifications(info, number); number++)
            std::cout << number << "  " << info.m_manufacturerName << " " << info.m_modelName << "  " << info.m_maxLinearForce
                      << " N\n";
        return 0;
    }
    chai3d::cGenericHapticDevicePtr device;
    if (!handler.getDeviceSpecifications(info, given.device) || !handler.getDevice(device, given.device))
        throw cogrip::error("--device " + std::to_string(given.device) + ": CHAI3D finds "
            + std::to_string(handler.getNumDevices()) + " devices; --list names them");
    const cogrip::options options = of(info, given);
    arm arm(device, info.m_modelName);
    cogrip::seat seat(given.target, options);
    for (cogrip_state state = seat.run(); state != COGRIP_SEATED && !stopped; state = seat.run()) {
        if (state == COGRIP_CLOSED) throw cogrip::error(seat.reason());
        cogrip_sleep_until(cogrip_now_ns() + 2'000'000);
    }
    if (stopped) return 0;
    std::cerr << "chai3d_join: " << seat.status().user << " holds the object by " << info.m_modelName << " at "
              << seat.status().device_hz << " Hz, with " << options.peak_force_n << " N at most\n";
    if (!cogrip::ask_for_real_time()) std::cerr << "chai3d_join: no real-time priority; ticks may be late\n";
    hold(arm, seat, given.seconds);
    return 0;
}

} // namespace

int main(int count, char **arguments) {
    std::signal(SIGINT, [](int) { stopped = 1; });
    std::signal(SIGTERM, [](int) { stopped = 1; });
    std::signal(SIGUSR1, [](int) { rearmed = 1; });
    try {
        return run(parse(count, arguments));
    } catch (const std::exception &wrong) {
        std::cerr << "chai3d_join: " << wrong.what() << "\n";
        return 1;
    }
}
