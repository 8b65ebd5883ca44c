/* CHAI3D's handler, which here knows custom devices alone: for machines without CHAI3D. */
#ifndef CHapticDeviceHandlerH
#define CHapticDeviceHandlerH

#include "devices/CMyCustomDevice.h"

namespace chai3d {

class cHapticDeviceHandler {
public:
    unsigned int getNumDevices() { return cMyCustomDevice::getNumDevices(); }
    bool getDeviceSpecifications(cHapticDeviceInfo &a_specifications, unsigned int a_index = 0) {
        if (a_index >= getNumDevices()) return C_ERROR;
        a_specifications = cMyCustomDevice(a_index).getSpecifications();
        return C_SUCCESS;
    }
    bool getDevice(cGenericHapticDevicePtr &a_device, unsigned int a_index = 0) {
        if (a_index >= getNumDevices()) return C_ERROR;
        a_device = cMyCustomDevice::create(a_index);
        return C_SUCCESS;
    }
};

} // namespace chai3d
#endif
