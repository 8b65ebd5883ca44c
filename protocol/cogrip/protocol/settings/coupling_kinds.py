"""Kinds of coupling, by `coupling.kind` of the settings: a row for each, with all that a reader of settings needs to know.

What each end makes of a kind is in its own table: `cogrip.client.coupling.schemes` and `cogrip.server.schemes`.
"""

from typing import Literal, NamedTuple

Kind = Literal["wave", "local", "coupling", "tdpa", "partner"]


class DamperRow(NamedTuple):
    """The damper that a device itself renders: b of waves, B of virtual coupling. key: of [coupling]."""

    symbol: str
    key: Literal["impedance_nspm", "damping_nspm"]


class CouplingKind(NamedTuple):
    """Properties of a kind. None has a default: whoever adds a kind decides each.

    frame           message that carries a frame both ways, by its name in `cogrip.protocol.wire.messages`; of `Waves` alone a
                    scene has an energy limiter, and the line can be tuned live
    local           the client renders contact itself, so that its force does not wait for the line
    passive         creates no energy, given the passive server step and a decimator that creates none
    gated           a gate at each hand's own spring bounds what it gets, and no line carries energy (theory 5b)
    own_frame       the server answers with the object in each person's own frame, from where that hand began
    any_world       fits kinds that are not plain, such as worlds of other packages, and grippers
    one_object      fits one free object that is held from all sides, a cube or the one free body of a scene, and nothing else
    paper_step      knows the paper's own server step
    damper          damper that the device renders
    softer_key      key of [coupling] to lower where the force oscillates
    linear          form of its linear model (`cogrip.analysis.linear.linear_session`); None: it is not linear
    advised_frames  frames of both directions together up to which a client that joins has the model computed: about 2 s
    """

    frame: Literal["Waves", "State", "Power", "Partner"]
    local: bool
    passive: bool
    gated: bool
    own_frame: bool
    any_world: bool
    one_object: bool
    paper_step: bool
    damper: DamperRow
    softer_key: Literal["impedance_nspm", "stiffness_npm"]
    linear: Literal["passive", "coupling"] | None
    advised_frames: int

    @property
    def waves(self) -> bool:
        """True where both ends send waves."""
        return self.frame == "Waves"

    @property
    def poses(self) -> bool:
        """True where a scene may have poses."""
        return self.waves or self.gated

    @property
    def copies(self) -> str:
        """Sentence for whoever looks at the object where each hand feels another copy of it; "" where there is one object."""
        return "Shown is the server's copy of the object: each hand feels a copy of its own." if self.gated else ""

    @property
    def felt_through_waves(self) -> bool:
        """True where contact is felt through wave lines: they make it softer, and compensation makes up for that."""
        return self.waves and not self.local


_IMPEDANCE, _DAMPING = DamperRow("b", "impedance_nspm"), DamperRow("B", "damping_nspm")
COUPLING_KINDS: dict[Kind, CouplingKind] = {
    "wave": CouplingKind(
        frame="Waves", local=False, passive=True, gated=False, own_frame=False, any_world=True,
        one_object=False, paper_step=True, damper=_IMPEDANCE, softer_key="impedance_nspm", linear="passive", advised_frames=96,
    ),
    "local": CouplingKind(  # its linear model is that of each client's own contact, which has no delay
        frame="Waves", local=True, passive=True, gated=False, own_frame=False, any_world=False,
        one_object=False, paper_step=False, damper=_DAMPING, softer_key="stiffness_npm", linear="coupling", advised_frames=512,
    ),
    "coupling": CouplingKind(
        frame="State", local=False, passive=False, gated=False, own_frame=True, any_world=False,
        one_object=False, paper_step=False, damper=_DAMPING, softer_key="stiffness_npm", linear="coupling", advised_frames=40,
    ),
    "tdpa": CouplingKind(
        frame="Power", local=False, passive=True, gated=False, own_frame=False, any_world=False,
        one_object=False, paper_step=False, damper=_IMPEDANCE, softer_key="stiffness_npm", linear=None, advised_frames=512,
    ),
    "partner": CouplingKind(
        frame="Partner", local=False, passive=True, gated=True, own_frame=True, any_world=False,
        one_object=True, paper_step=False, damper=_DAMPING, softer_key="stiffness_npm", linear=None, advised_frames=512,
    ),
}  # fmt: skip

UNLENT_MJ = 1.0
"""Energy that a scheme without a credit may give out before it is not passive [mJ]: it moves an arm of 75 g at 0.16 m/s."""

GATE_MJ = 50.0
"""Energy E_0 that a gate lets its hand take beyond what that has put in and partners gave, once in its life [mJ]."""


def lent_mj(kind: Kind, tank_mj: float) -> float:
    """Return what may come out beyond what came in [mJ]: of a wave line each direction's credit, of a gate its E_0.

    Beside E_0 a gate may let UNLENT_MJ pass, what the hand takes in two ticks; of other schemes it is that alone.
    """
    kinds = COUPLING_KINDS[kind]
    if kinds.gated:
        return GATE_MJ + UNLENT_MJ
    return tank_mj if kinds.waves else min(tank_mj, UNLENT_MJ)
