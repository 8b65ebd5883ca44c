"""An arm that speaks CRTK on ROS 2's wire, by Cyclone DDS alone: a mass in a hand that pulls, stepped 1000 times a second.

`run` is a process of its own: `code=PROGRAM`, with the arm's orders as JSON text. It prints `the arm is there`, and once it is
ended by SIGTERM writes a file: each position that it sent, and stamp and force of each servo_cf, in the order of their coming.
"""

import json
import os
import signal
import sys
import time
from contextlib import suppress
from math import nan, pi, sin
from pathlib import Path
from typing import Any

import msgspec
from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from cogrip.machine.realtime import PRIORITY

from tests.clients.dds_messages import PoseStamped, Time, WrenchStamped

ROOT = Path(__file__).parents[2]
PROGRAM = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from tests.clients.dds_arm import run; run()"
MASS_KG, STIFFNESS_NPM, DAMPING_NSPM = 0.3, 300.0, 10.0
LONGEST_STEP_S = 0.002
PULL_M, PULL_HZ = 0.02, 0.5
LOST_FORCE_S = 0.05  # time without a servo_cf after which the arm's motors push no more


class Orders(msgspec.Struct):
    """Orders to the arm. A fault begins once so many forces were read."""

    domain: int
    namespace: str
    left: str  # file of all that it read
    best_effort: bool = False  # quality of its measured_cp
    fault: str = ""  # "nan", "silent" (sends no more), "stuck" (sends the same message again and again), "dies"
    fault_after: int = 0


def run() -> None:
    orders = msgspec.json.decode(sys.argv[1], type=Orders)
    with suppress(AttributeError, OSError):  # an arm has a processor of its own
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))
    arm = Arm(orders)
    signal.signal(signal.SIGTERM, lambda number, frame: arm.end())
    print("the arm is there", flush=True)
    arm.run()


class Arm:
    def __init__(self, orders: Orders) -> None:
        self._orders = orders
        self._ended = self._faulty = False
        participant = DomainParticipant(orders.domain)
        reliable = Policy.Reliability.Reliable(duration(milliseconds=100))
        said = Policy.Reliability.BestEffort if orders.best_effort else reliable
        last = Policy.History.KeepLast(1)
        pose = Topic(participant, f"rt/{orders.namespace}/measured_cp", PoseStamped)
        wrench = Topic(participant, f"rt/{orders.namespace}/servo_cf", WrenchStamped)
        self._poses = DataWriter(participant, pose, Qos(said, last))
        self._forces = DataReader(participant, wrench, Qos(reliable, Policy.History.KeepAll))
        self._waits = WaitSet(participant)
        self._waits.attach(ReadCondition(self._forces, SampleState.NotRead | ViewState.Any | InstanceState.Alive))
        self._read: list[tuple[int, float]] = []  # stamp [ns], force [N]
        self._places: list[float] = []  # positions that were sent [m]
        self._message = PoseStamped()
        self._force_n = self._x = self._v = 0.0

    def end(self) -> None:
        self._ended = True

    def run(self) -> None:
        began = before = heard = time.monotonic()
        while not self._ended:
            self._waits.wait(duration(milliseconds=1))
            now = time.monotonic()
            for message in self._forces.take(N=64):
                if isinstance(message, WrenchStamped):
                    stamp = message.header.stamp
                    self._force_n, heard = message.wrench.force.x, now
                    self._read.append((stamp.sec * 10**9 + stamp.nanosec, self._force_n))
                    if len(self._read) % 500 == 0:
                        print(f"{len(self._read)} forces read", flush=True)
            if now - heard > LOST_FORCE_S:
                self._force_n = 0.0
            self._step(now - began, min(now - before, LONGEST_STEP_S))
            before = now
            self._send()
        left = {"sent": self._places, "read": self._read}
        Path(self._orders.left).write_text(json.dumps(left))

    def _step(self, time_s: float, step_s: float) -> None:
        rest = PULL_M * (1.0 + 0.5 * sin(2.0 * pi * PULL_HZ * time_s))
        force = self._force_n + STIFFNESS_NPM * (rest - self._x) - DAMPING_NSPM * self._v
        self._v += force / MASS_KG * step_s
        self._x += self._v * step_s

    def _send(self) -> None:
        fault = self._orders.fault if len(self._read) >= self._orders.fault_after else ""
        if fault and not self._faulty:
            print("the fault begins", flush=True)
            self._faulty = True
        if fault == "silent":
            return
        if fault == "dies":
            os._exit(1)
        if fault != "stuck":
            self._message = self._pose(nan if fault == "nan" else self._x)
        self._poses.write(self._message)
        self._places.append(self._message.pose.position.x)

    @staticmethod
    def _pose(x: float) -> Any:
        message = PoseStamped()
        message.header.stamp = Time(*divmod(time.time_ns(), 10**9))
        message.pose.position.x = x
        return message
