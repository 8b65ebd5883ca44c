/* A scene of CHAI3D, with its own tool and contact law, whose tool is a seat: 1 N draws the tool to a wall at x = 0.02 m.
 *
 *     ./scene TARGET SECONDS NAME
 */
#include "chai3d.h"

#include "seat_device.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <iostream>

using namespace chai3d;

int main(int, char **arguments) {
    const double face_m = 0.02, radius_m = 0.004, seconds = std::strtod(arguments[2], nullptr);
    cogrip::options options = cogrip::seat_device::defaults();
    options.name = arguments[3];
    const auto seat = cogrip::seat_device::create(arguments[1], options);
    cGenericHapticDevicePtr device = seat; /* all that the scene itself knows */

    cWorld *world = new cWorld();
    cToolCursor *tool = new cToolCursor(world);
    world->addChild(tool);
    tool->setHapticDevice(device);
    tool->setRadius(radius_m);
    tool->setWorkspaceRadius(device->getSpecifications().m_workspaceRadius); /* metre for metre */
    if (!tool->start()) {
        std::cerr << "scene: " << seat->reason() << "\n";
        return 1;
    }
    cMesh *wall = new cMesh();
    cCreateBox(wall, 0.04, 0.6, 0.6);
    wall->setLocalPos(face_m + 0.02, 0.0, 0.0);
    wall->m_material->setStiffness(0.8 * device->getSpecifications().m_maxLinearStiffness);
    wall->createAABBCollisionDetector(radius_m);
    world->addChild(wall);

    long touched = 0, ticks = 0;
    double most_n = 0.0, deepest_m = 0.0, last_mps = 0.0;
    cVector3d place, velocity, force;
    const std::int64_t begun_ns = cogrip_now_ns();
    for (double time_s = 0.0; time_s < seconds; time_s = 1e-9 * static_cast<double>(cogrip_now_ns() - begun_ns)) {
        world->computeGlobalPositions(true);
        tool->updateFromDevice();
        tool->computeInteractionForces();
        touched += tool->m_hapticPoint->getNumCollisionEvents() > 0;
        tool->addDeviceGlobalForce(1.0, 0.0, 0.0);
        tool->applyToDevice();
        device->getPosition(place);
        device->getLinearVelocity(velocity);
        device->getForce(force);
        most_n = std::max(most_n, force.length());
        deepest_m = std::max(deepest_m, place.x() + radius_m - face_m);
        if (time_s > 0.75 * seconds) last_mps = std::max(last_mps, velocity.length());
        ticks++;
    }
    tool->stop();
    const cogrip_status status = seat->status();
    std::printf("{\"chai3d\": \"%s\", \"ticks\": %ld, \"touched\": %ld, \"frames\": %lld, \"applied_n\": %.3f, "
                "\"deepest_m\": %.5f, \"last_mps\": %.4f, \"device_margin_j\": %.3e}\n",
        cGetVersion().c_str(), ticks, touched, static_cast<long long>(status.down.applied), most_n, deepest_m, last_mps,
        status.device_margin_j);
    if (!seat->reason().empty()) std::cerr << "scene: " << seat->reason() << "\n";
    delete world;
    return !seat->reason().empty();
}
