/* A haptic device of CHAI3D that is a seat of a cogrip room: an application of CHAI3D takes part where it holds this in place
 * of an arm. Header alone; needs CHAI3D's headers, cogrip.hpp and libcogrip.
 *
 *     auto device = cogrip::seat_device::create("127.0.0.1:47800", options);    // in place of handler->getDevice(device, 0)
 *
 * getPosition is where the seat's handle is on the object, setForce pushes it there, and with it the object and everybody who
 * holds that. Axes and units are the same in both: x toward the user, y to the right, z up, m and N; a force is that on the
 * handle.
 * docs/chai3d.md says what the application feels and what is let through.
 */
#ifndef COGRIP_SEAT_DEVICE_HPP
#define COGRIP_SEAT_DEVICE_HPP

#include "handle.hpp"

#include "devices/CGenericHapticDevice.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

namespace cogrip {

class seat_device : public chai3d::cGenericHapticDevice {
public:
    /* What the application's handle is like; `options` may name the seat and the room, and lower the peak force. */
    static options defaults() {
        options given;
        given.device = "chai3d:application";
        given.software = "chai3d";
        given.peak_force_n = 5.0;
        return given;
    }

    static std::shared_ptr<seat_device> create(const std::string &target, const options &given = defaults()) {
        return std::make_shared<seat_device>(target, given);
    }

    explicit seat_device(const std::string &target, const options &given = defaults()) : target_(target), options_(given) {
        options_.axes = COGRIP_AXES;
        options_.speed_mps = handle::speed_mps;
        options_.apparent_mass_kg = handle::mass_kg;
        options_.damping_nspm = handle::damping_nspm;
        m_specifications.m_model = chai3d::C_HAPTIC_DEVICE_CUSTOM;
        m_specifications.m_manufacturerName = "cogrip";
        m_specifications.m_modelName = "seat";
        m_specifications.m_maxLinearForce = options_.peak_force_n;
        m_specifications.m_maxLinearStiffness = handle::stiffness_npm;
        m_specifications.m_maxLinearDamping = handle::carried_nspm;
        m_specifications.m_workspaceRadius = 0.1;
        m_specifications.m_sensedPosition = true;
        m_specifications.m_actuatedPosition = true;
        m_specifications.m_leftHand = true;
        m_specifications.m_rightHand = true;
        m_deviceAvailable = true;
    }

    seat_device(const seat_device &) = delete;
    seat_device &operator=(const seat_device &) = delete;
    ~seat_device() override { end(); }

    /* Take the seat: waits for the server, 3 s at most. */
    bool open() override {
        if (m_deviceReady) return chai3d::C_SUCCESS;
        end();
        stopping_ = false;
        try {
            seat_.emplace(target_, options_);
            seat_->wait_until_seated();
        } catch (const std::exception &wrong) {
            seat_.reset();
            const std::lock_guard<std::mutex> lock(mutex_);
            shown_.reason = wrong.what();
            return chai3d::C_ERROR;
        }
        shown_ = shown{};
        asked_ = asked{};
        held_ = true;
        m_deviceReady = true;
        thread_ = std::thread([this] { hold(); });
        return chai3d::C_SUCCESS;
    }

    /* Release the object and leave: a second at most. */
    bool close() override {
        if (!m_deviceReady) return chai3d::C_ERROR;
        end();
        return chai3d::C_SUCCESS;
    }

    bool getPosition(chai3d::cVector3d &a_position) override { return give(a_position, &shown::position_m); }
    bool getLinearVelocity(chai3d::cVector3d &a_linearVelocity) override {
        return give(a_linearVelocity, &shown::velocity_mps);
    }

    /* The application's own force as it was let through, as other devices give what they were sent. */
    bool getForce(chai3d::cVector3d &a_force) override { return give(a_force, &shown::applied_n); }

    /* What the room pushes the handle with: for an application that shows or renders it elsewhere. */
    bool getRoomForce(chai3d::cVector3d &a_force) { return give(a_force, &shown::room_n); }

    /* Where the room's object is, a network's way ago: to be drawn. Never a place to answer with a force. */
    bool getObjectPosition(chai3d::cVector3d &a_position) { return give(a_position, &shown::object_m); }

    /* Torque and gripper force are dropped: the handle has three axes. An error: no seat, or a force that is not finite.
     * Returns with the seat's next tick, as a driver returns with its arm's next exchange: that paces an application's loop. */
    bool setForceAndTorqueAndGripperForce(const chai3d::cVector3d &a_force, const chai3d::cVector3d &, double) override {
        const vector force_n{a_force.x(), a_force.y(), a_force.z()};
        const bool finite = std::isfinite(force_n[0]) && std::isfinite(force_n[1]) && std::isfinite(force_n[2]);
        std::unique_lock<std::mutex> lock(mutex_);
        asked_.force_n = enabled_ ? force_n : vector{}; /* what is not finite is none: handle::ask */
        asked_.at_ns = cogrip_now_ns();
        if (finite) m_prevForce = a_force;
        const std::int64_t tick = shown_.status.tick;
        ticked_.wait_for(lock, most_wait, [&] { return shown_.status.tick != tick; });
        return m_deviceReady && held_ && finite;
    }

    /* Off: the application's force is none. On: also ends a fault, and both forces ramp in from zero. */
    bool enableForces(bool a_value) override {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (!a_value) asked_ = asked{};
        enabled_ = a_value;
        rearming_ = rearming_ || a_value;
        return m_deviceReady;
    }

    /* Status of the newest tick. */
    cogrip_status status() {
        const std::lock_guard<std::mutex> lock(mutex_);
        return shown_.status;
    }

    /* Why there is no seat, or no force; "" for neither. */
    std::string reason() {
        const std::lock_guard<std::mutex> lock(mutex_);
        return shown_.reason;
    }

private:
    static constexpr std::chrono::milliseconds most_wait{2};

    struct asked {
        vector force_n{};
        std::int64_t at_ns = INT64_MIN / 2;
    };
    struct shown {
        vector position_m{}, velocity_mps{}, applied_n{}, room_n{}, object_m{};
        cogrip_status status{};
        std::string reason;
    };

    bool give(chai3d::cVector3d &into, vector shown::*what) {
        const std::lock_guard<std::mutex> lock(mutex_);
        const vector &from = shown_.*what;
        into.set(from[0], from[1], from[2]);
        return m_deviceReady && held_;
    }

    void end() {
        stopping_ = true;
        if (thread_.joinable()) thread_.join();
        seat_.reset();
        m_deviceReady = false;
    }

    /* The thread of ticks. It never waits for the application: what is busy is taken a tick later. */
    void hold() {
        ask_for_real_time();
        const int hz = seat_->status().device_hz;
        pacer pacer(hz);
        handle handle(options_.peak_force_n);
        vector line_n{};
        asked newest;
        bool leaving = false;
        for (std::int64_t moved = 0; !seat_->done();) {
            const std::int64_t tick = pacer.wait();
            bool rearm = false;
            if (const std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock); lock) {
                newest = asked_;
                rearm = std::exchange(rearming_, false);
            }
            if (rearm && seat_->status().safety == COGRIP_FAULT) seat_->rearm();
            handle.ask(newest.force_n, newest.at_ns);
            const double gain = seat_->status().gain;
            for (; moved < tick; moved++) handle.step(line_n, gain, 1.0 / hz, cogrip_now_ns());
            line_n = seat_->tick(tick, handle.position_m(), handle.velocity_mps());
            if (stopping_ && !leaving) {
                seat_->leave("the application closed the device");
                leaving = true;
            }
            publish(handle, line_n);
        }
        const std::lock_guard<std::mutex> lock(mutex_);
        shown_.reason = seat_->reason();
        held_ = false;
    }

    void publish(const handle &handle, const vector &line_n) {
        const cogrip_status status = seat_->status();
        std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
        if (!lock) return;
        shown_.position_m = handle.position_m();
        shown_.velocity_mps = handle.velocity_mps();
        shown_.applied_n = handle.applied_n();
        for (std::size_t axis = 0; axis < line_n.size(); axis++) {
            shown_.room_n[axis] = -line_n[axis];
            shown_.object_m[axis] = status.object_m[axis];
        }
        if (status.safety != shown_.status.safety) shown_.reason = seat_->reason();
        shown_.status = status;
        lock.unlock();
        ticked_.notify_all();
    }

    std::string target_;
    options options_;
    std::optional<seat> seat_;
    std::thread thread_;
    std::atomic<bool> stopping_{false}, held_{false};
    std::mutex mutex_;
    std::condition_variable ticked_;
    asked asked_;
    shown shown_;
    bool enabled_ = true, rearming_ = false;
};

} // namespace cogrip
#endif
