/* One simulated hand holds the object of a running server, as example.c, by the header for C++.
 *
 *     ./example TARGET [SECONDS [NAME]]        TARGET: a join link, HOST:PORT, or - to read it from standard input
 *
 * Replace `hand` by your device: read its position, and push the hand with minus the force.
 */
#include "cogrip.hpp"

#include <cmath>
#include <cstdio>
#include <exception>
#include <iostream>

namespace {

/* A mass that a spring pulls to and fro along x. */
class hand {
public:
    static constexpr double mass_kg = 0.3;

    const cogrip::vector &position_m() const { return position_m_; }

    /* Move by a tick under the force that the device held: semi-implicit Euler. */
    void move(const cogrip::vector &force_n, double time_s, double tick_s) {
        for (std::size_t axis = 0; axis < position_m_.size(); axis++) {
            const double wanted_m = axis ? 0.0 : 0.03 * (1.0 - std::cos(3.14159265358979 * time_s));
            const double hand_n = 200.0 * (wanted_m - position_m_[axis]) - 10.0 * velocity_mps_[axis];
            velocity_mps_[axis] += tick_s / mass_kg * (hand_n - force_n[axis]);
            position_m_[axis] += tick_s * velocity_mps_[axis];
        }
    }

private:
    cogrip::vector position_m_{}, velocity_mps_{};
};

int hold(const std::string &target, double seconds, const std::string &name) {
    cogrip::options options;
    options.name = name;
    options.device = "c++:spring";
    options.rate_hz = 4096.0;
    options.peak_force_n = 8.0;
    options.speed_mps = 2.0;
    options.apparent_mass_kg = hand::mass_kg;
    cogrip::seat seat(target, options);
    seat.wait_until_seated();
    const double hz = seat.status().device_hz;
    std::cerr << "example: " << seat.status().user << " holds the object at " << hz << " Hz\n";

    if (!cogrip::ask_for_real_time()) std::cerr << "example: no real-time priority; ticks may be late\n";
    cogrip::pacer pacer(seat.status().device_hz);
    cogrip::vector force_n{};
    hand held;
    for (std::int64_t moved = 0; !seat.done();) {
        const std::int64_t tick = pacer.wait();
        for (; moved < tick; moved++) held.move(force_n, static_cast<double>(moved) / hz, 1.0 / hz);
        force_n = seat.tick(tick, held.position_m());
        if (static_cast<double>(tick) >= seconds * hz) seat.leave("its time is over");
    }
    const cogrip_status status = seat.status();
    std::printf("{\"library\": \"%s\", \"frames\": %lld, \"peak_force_n\": %.3f, \"object_m\": %.6f, "
                "\"down_margin_j\": %.3e, \"device_margin_j\": %.3e}\n",
        cogrip_version(), static_cast<long long>(status.down.applied), status.peak_force_n, status.object_m[0],
        status.down_margin_j, status.device_margin_j);
    if (!seat.reason().empty()) throw cogrip::error(seat.reason());
    return 0;
}

} // namespace

int main(int count, char **arguments) {
    std::string target = count > 1 ? arguments[1] : "";
    if (count < 2 || count > 4) {
        std::cerr << "usage: example TARGET [SECONDS [NAME]]   TARGET: a join link, HOST:PORT, or - for standard input\n";
        return 2;
    }
    if (target == "-") std::getline(std::cin, target);
    try {
        return hold(target, count > 2 ? std::stod(arguments[2]) : 10.0, count > 3 ? arguments[3] : "");
    } catch (const std::exception &wrong) {
        std::cerr << "example: " << wrong.what() << "\n";
        return 1;
    }
}
