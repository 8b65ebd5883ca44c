"""Haply's own host, HaplyHAPI, as one of its users writes it; a process of its own, as it knows one device a process.

Arguments: the port, a model, exchanges a force. Prints a JSON list, one entry a force: the position, the force and the torques
that it asked for, all as HaplyHAPI has them.
"""

import json
import sys

CW, CCW = 0, 1
FORCES_N = ((0.0, 0.0), (0.3, 0.0), (0.0, 0.3), (-0.2, -0.25))
# actuators (number, direction, port) and encoders (number, direction, offset, counts a turn, port) of Haply's own examples
WIRING = {
    "2diy": (((1, CCW, 2), (2, CCW, 1)), ((1, CCW, 168, 4880, 2), (2, CCW, 12, 4880, 1))),
    "2diy-metal": (((1, CCW, 2), (2, CW, 1)), ((1, CCW, 241, 10752, 2), (2, CW, -61, 10752, 1))),
    "pantograph": (((1, CW, 1), (2, CW, 2)), ((1, CW, 180, 13824, 1), (2, CW, 0, 13824, 2))),
}


def main(path: str, model: str, exchanges: int) -> None:
    from HaplyHAPI import Board, Device, Pantograph

    device = Device(5, Board("test", path, 0))
    mechanism = Pantograph(3 if model == "2diy" else 2)
    if model == "pantograph":
        mechanism.set_mechanism_parameters([0.05, 0.07, 0.02])  # those of its Java and C++
    device.set_mechanism(mechanism)
    actuators, encoders = WIRING[model]
    for actuator in actuators:
        device.add_actuator(*actuator)
    for encoder in encoders:
        device.add_encoder(*encoder)
    device.device_set_parameters()
    device.device_write_torques()  # none yet
    device.device_read_data()
    reported = []
    for force in FORCES_N:
        for _ in range(exchanges):
            position = device.get_device_position(device.get_device_angles())
            torques = device.set_device_torques(force)
            device.device_write_torques()
            device.device_read_data()
        reported.append({"position_m": position, "force_n": force, "torques_nm": torques})
    print(json.dumps(reported))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
