"""`ros2 run cogrip_ros2 hold LINK`: hold the object of a session with the arm in a namespace."""

import argparse
import sys
import threading
from contextlib import suppress
from typing import Any

from cogrip.api import ApiError, Capability, Client
from cogrip.machine.realtime import engage
from cogrip_ros2.crtk_device import CrtkDevice
from cogrip_ros2.interrupted import on_interrupt


def record(arguments: argparse.Namespace) -> Capability:
    """Return the arm's limits, as its flags give them. Raises DeviceError for a limit that is none."""
    half = 0.5 * arguments.workspace_m
    return Capability(
        family="crtk", model=arguments.arm or "arm", axes=3, workspace_m=((-half, half),) * 3, peak_force_n=arguments.peak_n,
        continuous_force_n=arguments.continuous_n, stiffness_npm=arguments.stiffness_npm, damping_nspm=arguments.damping_nspm,
        slew_nps=1000.0, speed_mps=arguments.speed_mps, resolution_m=arguments.resolution_m, apparent_mass_kg=arguments.mass_kg,
        rate_hz=arguments.rate_hz, gives_velocity=arguments.velocity, latency_ticks=1,
    )  # fmt: skip


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the flags; the limits are a small arm's."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("link", help="join link, or HOST:PORT on this machine")
    parser.add_argument("--arm", default="", help="namespace of measured_cp and servo_cf, such as MTML")
    parser.add_argument("--name", default="", help="seat to take")
    parser.add_argument("--folder", help="existing folder for the recording; none: nothing is recorded")
    parser.add_argument("--no-trial", action="store_true", help="don't try the motors before the seat is taken")
    parser.add_argument("--velocity", action="store_true", help="use measured_cv, too")
    limits = {
        "peak_n": 3.0, "continuous_n": 1.0, "stiffness_npm": 500.0, "damping_nspm": 5.0, "speed_mps": 1.0, "resolution_m": 5e-5,
        "mass_kg": 0.3, "workspace_m": 0.3,
    }  # fmt: skip
    for name, value in limits.items():
        parser.add_argument(f"--{name.replace('_', '-')}", type=float, default=value)
    parser.add_argument("--rate-hz", type=int, default=1024)
    return parser.parse_args(arguments)


def spin(node: Any) -> None:
    """Call a node's callbacks until the shutdown."""
    import rclpy
    from rclpy.executors import ExternalShutdownException

    with suppress(ExternalShutdownException):
        rclpy.spin(node)


def main(arguments: list[str] | None = None) -> int:
    """Hold until a signal or the session's end. Returns the exit code."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    flags = parse(rclpy.utilities.remove_ros_args(sys.argv)[1:] if arguments is None else arguments)
    engage(["fifo"])  # threads of middleware and executor inherit it: a busy machine would keep samples from the loop
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("cogrip_hold")
    device = CrtkDevice(node, record(flags), flags.arm)
    say = node.get_logger().info
    client = Client(flags.link, device, name=flags.name, folder=flags.folder, say=say, trial=not flags.no_trial)
    spinning = threading.Thread(target=spin, args=(node,), daemon=True)
    spinning.start()
    try:
        with on_interrupt(client.stop) as came:
            account = client.run()
        say(f"peak force {account.peak_force_n:.2f} N")
        return 128 + came[0] if came else 0
    except ApiError as error:
        node.get_logger().error(str(error))
        return 1
    finally:
        rclpy.try_shutdown()
        spinning.join()
