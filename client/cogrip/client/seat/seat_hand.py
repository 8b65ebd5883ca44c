"""The hand of a seat: its device's record, how it moves its tool (theory 1.1), and what is changed of that in the session.

A change waits for a frame's border, where nothing of a frame is on its way into the line: the energy ledger then splits
between two ticks, exactly (`EnergyLedger.set_power_ratio`). Places of hand and tool stay, and the force ramps in anew.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from cogrip.client.coupling.interface import Coupling
from cogrip.client.effects.force import EffectForce
from cogrip.client.effects.hand_aids import HandAids
from cogrip.client.hand.grip_axes import GripAxes
from cogrip.client.hand.hand_map import HandMap
from cogrip.client.hand.handle import HandleReader, has_handle
from cogrip.client.hand.pose_axes import PoseAxes, Row, axis_masses, in_lengths
from cogrip.client.hand_changes import HandChanges
from cogrip.client.safety.energy_ledger import EnergyLedger
from cogrip.client.safety.limiter import Safety
from cogrip.client.seat.hand_motion import HandMotion
from cogrip.devices.device import Capability
from cogrip.devices.sample import Sample
from cogrip.protocol.axes import GRIP_AXES, PLACES, POSE_AXES
from cogrip.protocol.settings.hand import HandChange, unfit
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.tool_frame import ToolFrame
from cogrip.protocol.wire.messages import SetHand
from cogrip.protocol.wire.session import ClientSession


def axis_units_of(seat: SeatSettings) -> PoseAxes | GripAxes | None:
    """Return what makes lengths of the axes of a seat; None where all are."""
    axes, length_scale = seat.object.axes, seat.coupling.length_scale
    return PoseAxes(length_scale) if axes == POSE_AXES else GripAxes(length_scale) if axes == GRIP_AXES else None


class SeatHand:
    """Base of `SeatedClient`, which sets `coupling`, `safety`, `ledger`, `hand` and `effects`, and calls `follow` each tick.

    Inside, all of a hand that turns or has a gripper is in lengths (`pose_axes`, `grip_axes`): `force_n`, `hand` and what they
    are given to. `wrench`, `pose` and `twist` are as the device has them.
    """

    __slots__ = (
        "_axis_units", "_hand_map", "_ordered", "_record", "aids", "capability", "changes", "coupling", "effects", "force_n",
        "hand", "handle", "ledger", "safety", "session", "settings",
    )  # fmt: skip

    coupling: Coupling
    safety: Safety
    ledger: EnergyLedger
    hand: HandMotion
    effects: EffectForce | None

    def __init__(self, seat: SeatSettings, session: ClientSession, capability: Capability) -> None:
        self.settings = seat
        self.session = session
        self._axis_units = axis_units_of(seat)
        self.handle: HandleReader | None = None  # where the device has one
        self._set_record(capability)
        self.force_n: Row = (0.0,) * seat.object.axes
        self._hand_map: HandMap | None = None  # None: the tool moves as the hand, as all but the coupling see it
        self._ordered: HandChange | None = None  # what the next frame's border changes
        self.aids = HandAids(seat.workspace_limit, seat.gravity_compensation, self.capability, seat.rates.tick_s)
        self.changes = HandChanges(seat.hand_change)

    def _set_record(self, capability: Capability) -> None:
        self.capability = self._record = capability.first(self.settings.object.axes)
        if self._axis_units is not None:
            self._record = in_lengths(self.capability, self._axis_units.length_scale)
        if self.handle is None and has_handle(capability):
            self.handle = HandleReader(self.session.dropped)
        if self.handle is not None:
            self.handle.fit(capability)

    def _masses_kg(self) -> Row:
        """Apparent mass of each axis, in lengths; none where the waves are made of the velocity, as in P: of places alone."""
        if self.settings.coupling.encoder == "velocity":
            return ()
        return axis_masses(self.capability, self._axis_units.length_scale if self._axis_units is not None else 1.0)

    @property
    def pose(self) -> Row:
        """Position of the hand [m], and rotation vector [rad] or opening [m]."""
        position = self.hand.position_m
        return position if self._axis_units is None else self._axis_units.pose(position)

    @property
    def twist(self) -> Sequence[float]:
        """Velocity of the hand [m/s], and angular velocity [rad/s] or rate of opening [m/s]."""
        velocity = self.hand.velocity_mps
        return velocity if self._axis_units is None else self._axis_units.rates(velocity)

    @property
    def wrench(self) -> Row:
        """Force [N] and torque [N m], or force of the gripper [N], of this tick, shape (axes,)."""
        return self.force_n if self._axis_units is None else self._axis_units.wrench(self.force_n)

    def _fit_coupling(self) -> None:
        raise NotImplementedError

    def _set_tool(self, tool: ToolFrame) -> HandMap:
        """Have the tool follow the hand so."""
        hand_map = self._hand_map = HandMap(tool, self.settings.object.axes)
        self.ledger.set_power_ratio(hand_map.power_ratio)
        return hand_map

    def tool_m(self) -> Row:
        """Return the tool's place, in lengths."""
        position = self.hand.position_m
        return position if self._hand_map is None else self._hand_map.place(position)

    def tool_pose(self) -> Row:
        """Return the tool's position [m], and rotation vector [rad] or opening [m]."""
        hand_map, units = self._hand_map, self._axis_units
        if hand_map is None:
            return self.pose
        place = hand_map.place(self.hand.position_m)
        if units is None:
            return place
        return place[:PLACES] + hand_map.rotation(self.pose[PLACES:]) if hand_map.turns else units.pose(place)

    # Clutch and changes

    @property
    def clutched(self) -> bool:
        """Return whether the clutch is to be held, whatever its button does."""
        return self._hand_map is not None and self._hand_map.asked

    def clutch(self, held: bool) -> None:
        """Hold the clutch, or release it: from the next tick on."""
        (self._hand_map or self._set_tool(ToolFrame())).asked = held

    def set_hand(self, change: HandChange) -> None:
        """Set a change, which applies from the end of the frame under way."""
        self._ordered = change if self._ordered is None else change.after(self._ordered)

    def receive_change(self, message: SetHand) -> None:
        """Receive a change from the server, once; one that does not fit this hand is refused in the next report."""
        change = self.changes.receive(message)
        if change is not None:
            self.set_hand(HandChange() if unfit(change, self.settings.object.axes) else change)

    def holds(self) -> HandChange:
        """Return what holds now, as it is reported."""
        hand_map = self._hand_map
        tool = ToolFrame() if hand_map is None else hand_map.tool
        return HandChange(
            tool.position_scale, tool.force_scale, tool.rotation, hand_map is not None and hand_map.held,
            self.aids.limit, self.aids.carries,
        )  # fmt: skip

    def _follow(self, sample: Sample, border: bool) -> None:
        """Apply clutch and changes after a tick's sample. border: whether a frame ends here, or none has begun."""
        changed = border and self._ordered is not None
        if changed:
            self._change()
        if (hand_map := self._hand_map) is not None:
            hand_map.hold(hand_map.asked or bool(sample.buttons & hand_map.button), self.hand.position_m, self.pose)
            self.safety.event("clutch" if hand_map.held else "engage")
        if changed or (border and hand_map is not None and self.holds() != self.changes.holds):
            self.changes.report(self.holds())

    def _change(self) -> None:
        change, self._ordered = self._ordered, None
        assert change is not None
        hand_map = self._hand_map
        tool = change.frame(hand_map.tool if hand_map is not None else None)
        if tool != (hand_map.tool if hand_map is not None else ToolFrame()):
            if hand_map is None:
                hand_map = self._set_tool(ToolFrame())
            hand_map.change(tool, self.hand.position_m, self.pose)
            self.ledger.set_power_ratio(hand_map.power_ratio)
            self.settings = replace(self.settings, tool=tool)
            self._fit_coupling()
            if self.effects is not None:  # their springs held energy by the ratio before
                self.effects.begin_anew()
            self.safety.ramp_anew()
        if change.workspace_limit_m is not None or change.gravity_compensation is not None:
            self.aids.change(change)
            self.settings = replace(
                self.settings, workspace_limit=self.aids.limit, gravity_compensation=self.aids.carries
            )
            self.safety.ramp_anew()
        if change.clutch is not None:
            self.clutch(change.clutch)
