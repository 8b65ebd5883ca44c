/* An arm for CHAI3D at the place that it leaves to others, cMyCustomDevice: a mass that a hand pulls to and fro along x, moved
 * by the time that passes. ARM_FAILS: reads after which it gives no place any more. ARM_MODEL=tracker: without motors. */
#include "devices/CGenericHapticDevice.h" /* first: it says whether CHAI3D has custom devices */

#include "devices/CMyCustomDevice.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>

namespace chai3d {

namespace {
struct state {
    double begun_s = 0.0, moved_s = 0.0, place_m[3] = {}, speed_mps[3] = {}, force_n[3] = {}, peak_n = 0.0;
    long reads = 0;
} arm;
const char *setting(const char *name, const char *otherwise) {
    const char *value = std::getenv(name);
    return value ? value : otherwise;
}
double now_s() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

void move(double time_s, double step_s) {
    for (int axis = 0; axis < 3; axis++) {
        const double wanted_m = axis ? 0.0 : 0.03 * (1.0 - std::cos(3.14159265358979 * time_s));
        const double hand_n = 200.0 * (wanted_m - arm.place_m[axis]) - 10.0 * arm.speed_mps[axis];
        arm.speed_mps[axis] += step_s / 0.3 * (hand_n + arm.force_n[axis]);
        arm.place_m[axis] += step_s * arm.speed_mps[axis];
    }
}
} // namespace

cMyCustomDevice::cMyCustomDevice(unsigned int a_deviceNumber) : cGenericHapticDevice(a_deviceNumber) {
    const bool tracker = setting("ARM_MODEL", "") == std::string("tracker");
    m_specifications.m_model = C_HAPTIC_DEVICE_CUSTOM;
    m_specifications.m_manufacturerName = "tests";
    m_specifications.m_modelName = tracker ? "tracker" : "simulated arm";
    m_specifications.m_maxLinearForce = 8.0;
    m_specifications.m_maxLinearDamping = 20.0;
    m_specifications.m_sensedPosition = true;
    m_specifications.m_actuatedPosition = !tracker;
    m_deviceAvailable = true;
}
cMyCustomDevice::~cMyCustomDevice() = default;
bool cMyCustomDevice::open() {
    arm = state{};
    arm.begun_s = arm.moved_s = now_s();
    return m_deviceReady = true;
}
bool cMyCustomDevice::close() {
    const double left_n = std::fabs(arm.force_n[0]) + std::fabs(arm.force_n[1]) + std::fabs(arm.force_n[2]);
    std::fprintf(stderr, "arm: %ld reads, %.3f N at most, %.3f N at its end\n", arm.reads, arm.peak_n, left_n);
    m_deviceReady = false;
    return C_SUCCESS;
}
bool cMyCustomDevice::calibrate(bool) { return m_deviceReady; }
bool cMyCustomDevice::getPosition(cVector3d &a_position) {
    const double step_s = 0.0005, now = now_s();
    for (; arm.moved_s + step_s <= now; arm.moved_s += step_s) move(arm.moved_s - arm.begun_s, step_s);
    a_position.set(arm.place_m[0], arm.place_m[1], arm.place_m[2]);
    return m_deviceReady && arm.reads++ < std::atol(setting("ARM_FAILS", "1000000000"));
}
bool cMyCustomDevice::getRotation(cMatrix3d &a_rotation) {
    a_rotation.identity();
    return m_deviceReady;
}
bool cMyCustomDevice::getGripperAngleRad(double &a_angle) {
    a_angle = 0.0;
    return m_deviceReady;
}
bool cMyCustomDevice::getUserSwitches(unsigned int &a_userSwitches) {
    a_userSwitches = 0;
    return m_deviceReady;
}
bool cMyCustomDevice::setForceAndTorqueAndGripperForce(const cVector3d &a_force, const cVector3d &, double) {
    arm.force_n[0] = a_force.x();
    arm.force_n[1] = a_force.y();
    arm.force_n[2] = a_force.z();
    const double size = std::sqrt(a_force.x() * a_force.x() + a_force.y() * a_force.y() + a_force.z() * a_force.z());
    if (!(size <= arm.peak_n)) arm.peak_n = size;
    return m_deviceReady;
}
unsigned int cMyCustomDevice::getNumDevices() { return 1; }

} // namespace chai3d
