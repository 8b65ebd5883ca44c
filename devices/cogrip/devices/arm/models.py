"""The arms there are numbers for, by name. Sources: the tables of haptikfabrikenapi (HID) and hfabapi (serial).

What the tables do not say, and how the records got it:

- peak force 5 N, stiffness, damping, radius: the tables. slew: ours, none of them bounds it.
- continuous force: what the default current limits give in the worst direction at the worst place of the sphere of reach_m, the
  smallest over joints of limit / (column of the Jacobian, in amperes a newton), rounded down. The limits: 2 A, the public one
  of haptikfabrikenapi, whose amplifiers cannot hold more; 1 A for the vintage Phantom, of whose motors nobody states one. The
  Polhem's motors hold its weight with up to 0.94 A of that, as in hfabapi, where nothing switches it off.
- resolution: one count of the coarsest joint at the centre of the workspace, rounded up.
- apparent mass: the smallest over directions at the centre, of link masses and of rotors through the cables (Maxon catalogue,
  nominal: RE 30 34 g cm^2, RE 40 140 g cm^2); turret and handle are not stated, so the true one is larger. That is the safe
  side for b T/m. The vintage Phantom is given the Premium's data sheet value.
- rate: 1024 Hz. Serial frames go when the host sends them; a full-speed HID endpoint is polled once a millisecond, so at
  1024 Hz 24 ticks a second find no reply: they are counted, and the client goes on as the hand did.
- speed: 1.5 m/s, faster than hands hold on to anything; it is ours.
"""

from dataclasses import replace

from cogrip.devices.arm.gimbal import POLHEM, POLHEM_HID, VINTAGE
from cogrip.devices.arm.model import ArmModel
from cogrip.devices.arm.motors import CableDrive
from cogrip.devices.arm.parallel_drive import ParallelDrive, Weights
from cogrip.devices.arm.polhem import PlanarMasses, Polhem
from cogrip.devices.device import Capability, encoder_record
from cogrip.machine.rows import Vector

RATE_HZ = 1024
RE30_310007_NM_PER_A = 0.0259
RE30_310009_NM_PER_A = 0.0538
RE40_148877_NM_PER_A = 0.0603
RE25_118752_NM_PER_A = 0.0234

_LINKS = Weights(b_kg=0.170, c_kg=0.110, b_m=0.051, c_m=0.091)
_WOODEN_ARM = ParallelDrive(shoulder_m=0.080, links_m=(0.205, 0.245), origin_m=(0.220, 0.0, 0.080), weights=_LINKS)


def _alike(value: float) -> Vector:
    return value, value, value


def _record(
    family: str, model: str, reach_m: float, limits: tuple[float, float], continuous_n: float, numbers: tuple[float, float]
) -> Capability:  # fmt: skip
    """limits, numbers: see `encoder_record`."""
    box = ((-reach_m, reach_m),) * 3
    forces = (5.0, continuous_n)
    return encoder_record(family, model, box, forces, limits, numbers, rate_hz=RATE_HZ, speed_mps=1.5, latency_ticks=1)


_WOODEN_DRIVE = CableDrive(
    counts_per_turn=_alike(2000.0), capstan_m=_alike(0.010), body_m=(0.160, 0.120, 0.120), direction=_alike(1.0),
    motor_nm_per_a=_alike(RE30_310007_NM_PER_A), limit_ma=_alike(2000.0),
    full_scale_ma=3000.0,  # of the firmware's source build, which clamps nothing; its "6Amps" build: full_scale_ma=6000
)  # fmt: skip


_WOODENHAPTICS = ArmModel(
    kinematics=_WOODEN_ARM,
    drive=_WOODEN_DRIVE,
    home_counts=(0.0, 0.0, 6000.0),
    record=_record("hid", "woodenhaptics", 0.10, (1000.0, 8.0), 2.53, (6.42e-5, 0.022)),
    reach_m=0.10,
)

_WOODENHAPTICS_SERIAL = ArmModel(
    kinematics=_WOODEN_ARM,
    drive=replace(_WOODEN_DRIVE, direction=(1.0, -1.0, -1.0), full_scale_ma=6000.0),
    home_counts=(0.0, 0.0, -6000.0),
    record=replace(_WOODENHAPTICS.record, family="serial", model="woodenhaptics-serial", rate_hz=1024),
    reach_m=0.10,
)

_VINTAGE = ArmModel(
    kinematics=ParallelDrive(shoulder_m=0.0, links_m=(0.138, 0.112), origin_m=(0.138, 0.0, -0.097), weights=_LINKS),
    drive=CableDrive(
        counts_per_turn=_alike(4000.0), capstan_m=(0.013, 0.010, 0.010), body_m=(0.117, 0.077, 0.077),
        direction=(-1.0, 1.0, -1.0), motor_nm_per_a=_alike(RE25_118752_NM_PER_A), limit_ma=_alike(1000.0),
        full_scale_ma=3000.0,  # the table's; the firmware would take 6000
    ),
    home_counts=(0.0, 7700.0, 0.0),
    record=replace(
        _record("serial", "vintage", 0.10, (800.0, 8.0), 0.88, (2.82e-5, 0.075)), gives_orientation=True
    ),
    reach_m=0.10,
    gimbal=VINTAGE,
)  # fmt: skip

_POLHEM = ArmModel(
    kinematics=Polhem((0.034, 0.165, 0.025, 0.190, 0.034, 0.1308), (0.2045, 0.0, 0.0325), PlanarMasses(g_mps2=9.81)),
    drive=CableDrive(
        counts_per_turn=_alike(4096.0), capstan_m=(0.0288534, 0.0136981, 0.0137281), body_m=(0.175, 0.100, 0.100),
        direction=(1.0, -1.0, 1.0), motor_nm_per_a=(RE40_148877_NM_PER_A, RE30_310009_NM_PER_A, RE30_310009_NM_PER_A),
        limit_ma=_alike(2000.0), full_scale_ma=6000.0,
    ),
    home_counts=(8312.0, -10366.0, 19764.0),
    record=replace(
        _record("serial", "polhem", 0.15, (2000.0, 1.0), 1.16, (5.18e-5, 0.049)), gives_orientation=True
    ),
    reach_m=0.15,
    gimbal=POLHEM,
    gimbal_home_counts=(0.0, 30.0, 0.0),
    holds_weight=True,
)  # fmt: skip

# polhem_v3 of haptikfabrikenapi, with which an interface is made there if nothing else is said: other capstans, counted
# from another place. The linkage and the weights are those of hfabapi: the older source leaves that file out.
_POLHEM_HID = replace(
    _POLHEM,
    drive=replace(_POLHEM.drive, capstan_m=(0.0288, 0.0130, 0.010), full_scale_ma=3000.0),
    home_counts=(8327.0, -10926.0, 27140.0),
    record=replace(
        _record("hid", "polhem-hid", 0.15, (2000.0, 1.0), 1.25, (5.17e-5, 0.063)), buttons=1, gives_orientation=True
    ),
    gimbal=POLHEM_HID,
)

_DEFAULT_WOODY = replace(
    _WOODENHAPTICS,
    drive=replace(_WOODEN_DRIVE, direction=(1.0, -1.0, 1.0)),
    home_counts=_alike(0.0),  # as in its table: the counters count from all angles zero
    record=replace(_WOODENHAPTICS.record, model="default-woody"),
)

_WOODENHAPTICS_2019 = replace(
    _WOODENHAPTICS,
    drive=replace(_WOODEN_DRIVE, motor_nm_per_a=(0.321, RE40_148877_NM_PER_A, RE40_148877_NM_PER_A)),
    record=_record("hid", "woodenhaptics-v2019", 0.10, (1000.0, 8.0), 5.0, (6.42e-5, 0.048)),
)

_ALUHAPTICS = replace(
    _WOODENHAPTICS,
    kinematics=ParallelDrive(shoulder_m=0.111, links_m=(0.140, 0.111), origin_m=(0.140, 0.0, 0.0), weights=_LINKS),
    drive=replace(_WOODEN_DRIVE, capstan_m=(0.0138, 0.0098, 0.0098), body_m=(0.116, 0.076, 0.076)),
    home_counts=_alike(0.0),
    record=_record("hid", "aluhaptics", 0.10, (1000.0, 8.0), 1.83, (5.68e-5, 0.090)),
)

MODELS: dict[str, ArmModel] = {
    "aluhaptics": _ALUHAPTICS,
    "default-woody": _DEFAULT_WOODY,
    "polhem": _POLHEM,
    "polhem-hid": _POLHEM_HID,
    "vintage": _VINTAGE,
    "woodenhaptics": _WOODENHAPTICS,
    "woodenhaptics-serial": _WOODENHAPTICS_SERIAL,
    "woodenhaptics-v2019": _WOODENHAPTICS_2019,
}
"""Name -> model with its default drive."""
