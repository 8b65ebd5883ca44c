/* A simulated handle: what an application of CHAI3D holds in a room in place of an arm. No thread, no clock, no CHAI3D.
 *
 * It is a mass with drag, on which two forces act: that of the application, and that of the room's line. The application gives
 * a force and gets a place, the line takes a place and gives a force; a mass is between the two as no delay makes energy there.
 *
 * The application's force is let through finite, within `peak_n`, at most `slope_nps` steeper, while it is no older than
 * `stale_ns`, and by the gain of the C client: so both forces come and go together.
 */
#ifndef COGRIP_HANDLE_HPP
#define COGRIP_HANDLE_HPP

#include "cogrip.hpp"

#include <cmath>

namespace cogrip {

class handle {
public:
    static constexpr double mass_kg = 0.2;
    static constexpr double damping_nspm = 3.0;
    static constexpr double most_mps = 0.8;     /* the mass is never faster; `speed_mps` of its seat is above */
    static constexpr double speed_mps = 1.0;
    static constexpr double slope_nps = 1000.0;
    static constexpr std::int64_t stale_ns = 100'000'000;

    /* Largest stiffness and damping that an application may render at 1 kHz and stay stable: its force comes up to 2.5 ms after
     * the place that it answers. Drag pays for a stiffness of damping / delay, here half of it;
     * a damper may be a third of mass / delay. */
    static constexpr double delay_s = 0.0025;
    static constexpr double stiffness_npm = damping_nspm / delay_s / 2.0;
    static constexpr double carried_nspm = mass_kg / delay_s / 3.0;

    explicit handle(double peak_n) noexcept : peak_n_(peak_n) {}

    /* Take the application's force. False, and none, where it is not finite. */
    bool ask(const vector &force_n, std::int64_t now_ns) noexcept {
        const double size = length(force_n);
        const bool finite = std::isfinite(size);
        const double scale = !finite ? 0.0 : size > peak_n_ ? peak_n_ / size : 1.0;
        for (std::size_t axis = 0; axis < asked_n_.size(); axis++) asked_n_[axis] = finite ? scale * force_n[axis] : 0.0;
        asked_ns_ = now_ns;
        return finite;
    }

    /* Move by a tick, in which the seat held line_n (of cogrip: it resists motion) and let the share `gain` through. */
    void step(const vector &line_n, double gain, double tick_s, std::int64_t now_ns) noexcept {
        const bool fresh = now_ns - asked_ns_ <= stale_ns;
        vector change{};
        for (std::size_t axis = 0; axis < change.size(); axis++) change[axis] = (fresh ? asked_n_[axis] : 0.0) - held_n_[axis];
        const double steep = length(change), most = slope_nps * tick_s, share = steep > most ? most / steep : 1.0;
        for (std::size_t axis = 0; axis < change.size(); axis++) {
            held_n_[axis] += share * change[axis];
            applied_n_[axis] = gain * held_n_[axis];
            velocity_mps_[axis] = (velocity_mps_[axis] + tick_s / mass_kg * (applied_n_[axis] - line_n[axis]))
                / (1.0 + tick_s / mass_kg * damping_nspm); /* drag by backward Euler: it never gives */
        }
        const double speed = length(velocity_mps_), scale = speed > most_mps ? most_mps / speed : 1.0;
        for (std::size_t axis = 0; axis < change.size(); axis++) {
            velocity_mps_[axis] *= scale;
            position_m_[axis] += tick_s * velocity_mps_[axis];
        }
    }

    const vector &position_m() const noexcept { return position_m_; }
    const vector &velocity_mps() const noexcept { return velocity_mps_; }
    const vector &applied_n() const noexcept { return applied_n_; } /* of the application, as it was let through */

private:
    static double length(const vector &of) noexcept { return std::sqrt(of[0] * of[0] + of[1] * of[1] + of[2] * of[2]); }

    double peak_n_;
    std::int64_t asked_ns_ = INT64_MIN / 2;
    vector asked_n_{}, held_n_{}, applied_n_{}, position_m_{}, velocity_mps_{};
};

} // namespace cogrip
#endif
