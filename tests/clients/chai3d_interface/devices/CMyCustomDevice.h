/* The class that CHAI3D leaves to others to fill in, as its own header has it: for machines without CHAI3D. */
#ifndef CMyCustomDeviceH
#define CMyCustomDeviceH

#include "devices/CGenericHapticDevice.h"

namespace chai3d {

class cMyCustomDevice;
typedef std::shared_ptr<cMyCustomDevice> cMyCustomDevicePtr;

class cMyCustomDevice : public cGenericHapticDevice {
public:
    cMyCustomDevice(unsigned int a_deviceNumber = 0);
    virtual ~cMyCustomDevice();
    static cMyCustomDevicePtr create(unsigned int a_deviceNumber = 0) {
        return std::make_shared<cMyCustomDevice>(a_deviceNumber);
    }
    virtual bool open();
    virtual bool close();
    virtual bool calibrate(bool a_forceCalibration = false);
    virtual bool getPosition(cVector3d &a_position);
    virtual bool getRotation(cMatrix3d &a_rotation);
    virtual bool getGripperAngleRad(double &a_angle);
    virtual bool getUserSwitches(unsigned int &a_userSwitches);
    virtual bool setForceAndTorqueAndGripperForce(const cVector3d &a_force, const cVector3d &a_torque, double a_gripperForce);
    static unsigned int getNumDevices();
};

} // namespace chai3d
#endif
