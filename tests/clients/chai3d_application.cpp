/* An application of CHAI3D that holds a seat in place of an arm: its scene pulls the handle to and fro along x.
 *
 *     ./application TARGET SECONDS NAME [pull|silent|mad]
 *
 * silent: it sets no force in the second half; mad: it sets what is not a number there.
 */
#include "seat_device.hpp"

#include <cstdio>
#include <cstdlib>
#include <iostream>

using namespace chai3d;

int main(int count, char **arguments) {
    cogrip::options options = cogrip::seat_device::defaults();
    options.name = arguments[3];
    const std::string mode = count > 4 ? arguments[4] : "pull";
    const double seconds = std::strtod(arguments[2], nullptr);
    const auto seat = cogrip::seat_device::create(arguments[1], options);
    cGenericHapticDevicePtr device = seat; // all that the application itself knows
    if (!device->open()) {
        std::cerr << "application: " << seat->reason() << "\n";
        return 1;
    }
    device->calibrate();
    const cHapticDeviceInfo info = device->getSpecifications();
    double most_n = 0.0, room_n = 0.0, farthest_m = 0.0;
    long refused = 0, loops = 0;
    const std::int64_t begun_ns = cogrip_now_ns();
    cVector3d place, velocity, force, room;
    for (double time_s = 0.0; time_s < seconds; time_s = 1e-9 * static_cast<double>(cogrip_now_ns() - begun_ns)) {
        device->getPosition(place);
        device->getLinearVelocity(velocity);
        const double wanted_m = 0.03 * (1.0 - std::cos(3.14159265358979 * time_s)), nan = std::nan("");
        const double pull_n = 200.0 * (wanted_m - place.x()) - 5.0 * velocity.x();
        const bool second = time_s > 0.5 * seconds;
        if (!second || mode == "pull") refused += !device->setForce(cVector3d(pull_n, -100.0 * place.y(), -100.0 * place.z()));
        else if (mode == "mad") refused += !device->setForce(cVector3d(nan, 0.0, 0.0));
        device->getForce(force);
        seat->getRoomForce(room);
        const double size = std::hypot(force.x(), std::hypot(force.y(), force.z()));
        most_n = std::max(most_n, size);
        room_n = std::max(room_n, std::fabs(room.x()));
        farthest_m = std::max(farthest_m, place.x());
        loops++; /* setForce paces them */
        if (second && mode == "silent") cogrip_sleep_until(cogrip_now_ns() + 1'000'000);
    }
    device->getForce(force);
    seat->getObjectPosition(place);
    device->close();
    const cogrip_status status = seat->status();
    std::printf("{\"frames\": %lld, \"model\": \"%s\", \"applied_n\": %.3f, \"room_n\": %.3f, \"farthest_m\": %.4f, "
                "\"object_m\": %.4f, \"refused\": %ld, \"loops\": %ld, \"ticks\": %lld, \"last_n\": %.6f, "
                "\"device_margin_j\": %.3e}\n",
        static_cast<long long>(status.down.applied), info.m_modelName.c_str(), most_n, room_n, farthest_m, place.x(), refused,
        loops, static_cast<long long>(status.tick), std::hypot(force.x(), std::hypot(force.y(), force.z())),
        status.device_margin_j);
    if (!seat->reason().empty()) std::cerr << "application: " << seat->reason() << "\n";
    return !seat->reason().empty();
}
