/* The simulated handle in virtual time: an application at 1 kHz that answers a place two ticks later, and no room. Prints names
 * and numbers. */
#include "handle.hpp"

#include <algorithm>
#include <cstdio>
#include <deque>

namespace {

constexpr double tick_s = 1.0 / 1024.0, peak_n = 5.0;
constexpr std::int64_t tick_ns = 976'562;

/* Fastest motion in the last of six seconds at a wall of a stiffness and damping, into which 1 N presses. */
double at_a_wall(double stiffness_npm, double damping_nspm) {
    cogrip::handle handle(50.0);
    std::deque<cogrip::vector> answers(2);
    double fastest_mps = 0.0;
    for (int tick = 0; tick < 6 * 1024; tick++) {
        const double depth_m = std::max(0.0, handle.position_m()[0]);
        const double wall_n = depth_m > 0.0 ? stiffness_npm * depth_m + damping_nspm * handle.velocity_mps()[0] : 0.0;
        answers.push_back({1.0 - wall_n, 0.0, 0.0});
        handle.ask(answers.front(), tick * tick_ns);
        answers.pop_front();
        handle.step({}, 1.0, tick_s, tick * tick_ns);
        if (tick >= 5 * 1024) fastest_mps = std::max(fastest_mps, std::fabs(handle.velocity_mps()[0]));
    }
    return fastest_mps;
}

/* Steepest change and largest of the applied force over a second of what is asked for; the force 0.15 s after the last word. */
void limits(const char *name, double asked_n, double gain) {
    cogrip::handle handle(peak_n);
    double before_n = 0.0, steepest_n = 0.0, largest_n = 0.0;
    bool taken = true;
    for (int tick = 0; tick < 1024 + 154; tick++) {
        if (tick < 1024) taken = handle.ask({asked_n, asked_n, 0.0}, tick * tick_ns) && taken;
        handle.step({}, gain, tick_s, tick * tick_ns);
        const cogrip::vector now_n = handle.applied_n();
        const double size_n = std::hypot(now_n[0], now_n[1]);
        steepest_n = std::max(steepest_n, std::fabs(size_n - before_n));
        largest_n = std::max(largest_n, size_n);
        before_n = size_n;
    }
    std::printf("%s_taken %d\n%s_steepest_n %.9f\n%s_largest_n %.9f\n%s_after_n %.9f\n%s_speed_mps %.9f\n", name, taken, name,
        steepest_n, name, largest_n, name, before_n, name, std::hypot(handle.velocity_mps()[0], handle.velocity_mps()[1]));
}

/* Displacement of a handle that the line alone pushes with -1 N for a second: what a force that resists motion does. */
double pushed_m() {
    cogrip::handle handle(peak_n);
    for (int tick = 0; tick < 1024; tick++) handle.step({-1.0, 0.0, 0.0}, 1.0, tick_s, tick * tick_ns);
    return handle.position_m()[0];
}

} // namespace

int main() {
    const double K = cogrip::handle::stiffness_npm, B = cogrip::handle::carried_nspm;
    std::printf("stiffness_npm %.3f\ncarried_nspm %.3f\n", K, B);
    std::printf("stiff_mps %.9f\ndamped_mps %.9f\nboth_mps %.9f\n", at_a_wall(K, 0.0), at_a_wall(0.1 * K, B), at_a_wall(K, B));
    std::printf("too_stiff_mps %.9f\ntoo_damped_mps %.9f\n", at_a_wall(5.0 * K, 0.0), at_a_wall(0.1 * K, 7.0 * B));
    limits("strong", 1e6, 1.0);
    limits("weak", 1.0, 1.0);
    limits("half", 1.0, 0.5);
    limits("none", 1.0, 0.0);
    limits("mad", std::nan(""), 1.0);
    limits("infinite", HUGE_VAL, 1.0);
    std::printf("pushed_m %.6f\n", pushed_m());
    return 0;
}
