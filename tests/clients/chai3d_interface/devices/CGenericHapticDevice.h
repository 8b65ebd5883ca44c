/* The part of CHAI3D 3's interface that clients/chai3d uses, written after its documentation: for machines without CHAI3D. */
#ifndef CGenericHapticDeviceH
#define CGenericHapticDeviceH

#include <memory>
#include <string>

namespace chai3d {

const bool C_ERROR = false;
const bool C_SUCCESS = true;

class cVector3d {
public:
    cVector3d() = default;
    cVector3d(double x, double y, double z) : m_x(x), m_y(y), m_z(z) {}
    double x() const { return m_x; }
    double y() const { return m_y; }
    double z() const { return m_z; }
    void set(double x, double y, double z) { *this = cVector3d(x, y, z); }
    void zero() { set(0.0, 0.0, 0.0); }

private:
    double m_x = 0.0, m_y = 0.0, m_z = 0.0;
};

class cMatrix3d {
public:
    void identity() {}
};

enum cHapticDeviceModel { C_HAPTIC_DEVICE_VIRTUAL, C_HAPTIC_DEVICE_CUSTOM };

struct cHapticDeviceInfo {
    cHapticDeviceModel m_model = C_HAPTIC_DEVICE_VIRTUAL;
    std::string m_modelName = "no device", m_manufacturerName = "none";
    double m_maxLinearForce = 0.1, m_maxLinearStiffness = 0.1, m_maxLinearDamping = 0.0, m_workspaceRadius = 0.1;
    bool m_sensedPosition = false, m_actuatedPosition = false, m_leftHand = false, m_rightHand = false;
};

class cGenericDevice {
public:
    explicit cGenericDevice(unsigned int = 0) {}
    virtual ~cGenericDevice() = default;
    virtual bool open() { return C_ERROR; }
    virtual bool close() { return C_ERROR; }
    bool isDeviceAvailable() { return m_deviceAvailable; }
    bool isDeviceReady() { return m_deviceReady; }

protected:
    bool m_deviceAvailable = false, m_deviceReady = false;
};

class cGenericHapticDevice;
typedef std::shared_ptr<cGenericHapticDevice> cGenericHapticDevicePtr;

class cGenericHapticDevice : public cGenericDevice {
public:
    explicit cGenericHapticDevice(unsigned int a_deviceNumber = 0) : cGenericDevice(a_deviceNumber) {}
    virtual bool calibrate(bool = false) { return m_deviceReady; }
    virtual bool getPosition(cVector3d &a_position) {
        a_position.zero();
        return m_deviceReady;
    }
    virtual bool getLinearVelocity(cVector3d &a_velocity) {
        a_velocity.zero();
        return m_deviceReady;
    }
    virtual bool getRotation(cMatrix3d &a_rotation) {
        a_rotation.identity();
        return m_deviceReady;
    }
    virtual bool getGripperAngleRad(double &a_angle) {
        a_angle = 0.0;
        return m_deviceReady;
    }
    virtual bool getForce(cVector3d &a_force) {
        a_force = m_prevForce;
        return m_deviceReady;
    }
    virtual bool getUserSwitches(unsigned int &a_switches) {
        a_switches = 0;
        return m_deviceReady;
    }
    cHapticDeviceInfo getSpecifications() { return m_specifications; }
    bool setForce(const cVector3d &a_force) { return setForceAndTorqueAndGripperForce(a_force, cVector3d(), 0.0); }
    virtual bool setForceAndTorqueAndGripperForce(const cVector3d &, const cVector3d &, double) { return m_deviceReady; }
    virtual bool enableForces(bool) { return true; }
    cHapticDeviceInfo m_specifications;

protected:
    cVector3d m_prevForce;
};

} // namespace chai3d
#endif
