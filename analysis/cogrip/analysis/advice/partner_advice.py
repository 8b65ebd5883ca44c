"""Advice on a room of partners' models (`coupling.kind = "partner"`): bounds, feel, loop gain."""

from cogrip.analysis.advice.advice import overloads
from cogrip.analysis.advice.finding import Finding, Level, plain
from cogrip.analysis.linear.linear_session import seats_on_devices
from cogrip.analysis.linear.partner_loop import PartnerLoop
from cogrip.protocol.settings.coupling_kinds import GATE_MJ
from cogrip.protocol.settings.sections import Settings

HANDS_NPM = (40.0, 80.0, 150.0, 300.0, 600.0, 1000.0)  # stiffness of the hands advised on, a limp one to a stiff one
USUAL_NPM = 300.0
LONG_MS = 100.0  # delay each way from which hands that move alike feel as much error as force (docs/partner.md)


def partner_loop(settings: Settings) -> PartnerLoop:
    """Return the loop of a room, with the lightest of its devices. Raises DeviceError."""
    seats, records = zip(*seats_on_devices(settings), strict=True)
    record = min(records, key=lambda each: each.apparent_mass_kg)
    coupling, thing = seats[0].coupling, seats[0].object
    return PartnerLoop(
        len(seats), coupling.stiffness_npm, coupling.damping_nspm, thing.mass_kg, thing.damping_nspm,
        record.apparent_mass_kg, record.own_damping_nspm,
    )  # fmt: skip


def partner_warnings(settings: Settings) -> tuple[str, ...]:
    """Return what is to be said of a room before it is used. Raises DeviceError."""
    return tuple(finding.text for finding in partner_findings(settings) if finding.level == "warning")


def partner_findings(settings: Settings) -> list[Finding]:
    """Return what can be said of a room before anyone holds a device. Raises DeviceError."""
    found = [Finding("device", text, "warning", refused=True) for text in overloads(settings)]
    people = len(settings.users)
    found.append(
        Finding("passivity", f"gates: no hand takes out more than {GATE_MJ:g} mJ, what it put in and partners gave")
    )
    if people < 2:
        return [*found, Finding("stability", "one person alone: there is nobody to model")]
    if settings.object.traits.scene:
        text = "each client steps a copy of the scene, of which there is no linear model; hands may swing, and gates bound it"
        return [*found, Finding("stability", text)]
    loop = partner_loop(settings)
    gains = {hand: loop.worst(hand) for hand in HANDS_NPM}
    calm = [hand for hand, gain in gains.items() if gain < 1.0]
    each = ", ".join(f"{gains[hand]:.2f} ({hand:g})" for hand in HANDS_NPM)
    level: Level
    if len(calm) == len(gains):
        text, level = "below 1: stable at any delay, by the linear model without gates", "ok"
    elif calm:
        reach = f"{calm[0]:g} to {calm[-1]:g} N/m"
        text = f"below 1, and so stable at any delay, for hands of {reach}; others may swing, and gates bound it"
        level = "note"
    else:
        text, level = "above 1: hands may swing against each other, and gates bound it", "note"
    found.append(Finding("stability", f"loop gain of {people} hands, for hands of so many N/m: {each}; {text}", level))
    found.append(
        Finding(
            "feel", f"against partners at rest of {USUAL_NPM:g} N/m: {plain(loop.felt_npm(USUAL_NPM))} N/m at any delay"
        )
    )
    delay_ms = max(seat.up.delay_ms + seat.down.delay_ms for seat, _ in seats_on_devices(settings)) / 2.0
    if delay_ms >= LONG_MS:
        text = f"{delay_ms:g} ms each way: hands that move alike, and limp ones, feel about as much error as force"
        found.append(Finding("feel", text, "note"))
    return found
