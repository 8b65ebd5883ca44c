"""Emulated impairment of the datagrams of one direction: [link] of the settings, and its form in the welcome."""

from typing import Annotated, Any, Literal

import msgspec

from cogrip.protocol.settings.errors import expects
from cogrip.protocol.settings.network_profiles import PROFILES, ProfileName
from cogrip.protocol.settings.table import SettingsError

Milliseconds = Annotated[float, msgspec.Meta(ge=0.0, le=10_000.0)]
Probability = Annotated[float, msgspec.Meta(ge=0.0, le=0.99)]
Burst = Annotated[float, msgspec.Meta(ge=1.0, le=1e4)]
Rate = Annotated[float, msgspec.Meta(ge=0.0, le=1e7)]
OutageSeconds = Annotated[float, msgspec.Meta(ge=0.0, le=1e4)]
OutageStart = Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]
MOST_OUTAGES = 64  # most outages of a script
Length = Annotated[float, msgspec.Meta(gt=0.0, le=1e4)]
Outages = Annotated[tuple[tuple[OutageStart, Length], ...], msgspec.Meta(max_length=MOST_OUTAGES)]
"""Scripted outages: (start_s, length_s) of each."""
TracePath = Annotated[str, msgspec.Meta(min_length=1, max_length=4096)]
LEAST_KBPS = 1.0

Direction = Literal["up", "down"]


def check_cap(path: str, rate_kbps: float | None) -> None:
    """Check a rate cap. Raises SettingsError for one that would hold a datagram for ever."""
    if rate_kbps and rate_kbps < LEAST_KBPS:
        raise SettingsError(expects(path, f"a number of at least {LEAST_KBPS:g}, or 0 for no cap", rate_kbps))


def check_outages(where: str, outage_s: float, outage_every_s: float) -> None:
    """Check outages. Raises SettingsError for outages that would never come, or never end."""
    if outage_s > 0.0 and outage_every_s <= outage_s:
        raise SettingsError(
            f"{where}outage_s = {outage_s:g}: {where}outage_every_s, from one outage's begin to the next, is "
            f"{outage_every_s:g}; give more than {outage_s:g}"
        )
    if outage_every_s > 0.0 and outage_s <= 0.0:
        raise SettingsError(
            f"{where}outage_every_s = {outage_every_s:g}: {where}outage_s, how long each lasts, is 0; give more, "
            "or leave both out"
        )


class LinkDirection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One direction's own values; what is None is taken from [link]."""

    delay_ms: Milliseconds | None = None
    jitter_ms: Milliseconds | None = None
    loss: Probability | None = None
    burst_frames: Burst | None = None
    duplicate: Probability | None = None
    reorder: Probability | None = None
    rate_kbps: Rate | None = None
    outage_s: OutageSeconds | None = None  # length of each periodic outage
    # time from the beginning of a periodic outage to that of the next; the first one begins after as long
    outage_every_s: OutageStart | None = None
    outages: Outages | None = None  # scripted outages, beside periodic ones
    trace: TracePath | None = None  # path of a file of recorded delays and losses, used beside the above


class LinkProfile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, array_like=True):
    """Impairment of one direction. rate_kbps = 0 means no cap, else at least LEAST_KBPS.

    Outages count from the direction's first datagram: one of outage_s at every multiple of outage_every_s but 0. A welcome
    carries this and must not be longer than a hello: scripts have no room in it.
    """

    delay_ms: Milliseconds = 0.0
    jitter_ms: Milliseconds = 0.0
    loss: Probability = 0.0
    burst_frames: Burst = 1.0
    duplicate: Probability = 0.0
    reorder: Probability = 0.0
    rate_kbps: Rate = 0.0
    outage_s: OutageSeconds = 0.0
    outage_every_s: OutageStart = 0.0

    def __post_init__(self) -> None:
        check_cap("rate_kbps", self.rate_kbps)
        check_outages("", self.outage_s, self.outage_every_s)


class Link(LinkDirection, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """[link] holds for both directions; [link.up] (client to server) and [link.down] override it.

    profile: a network by name, whose values stand where neither says anything.
    """

    profile: ProfileName | None = None
    up: LinkDirection = LinkDirection()
    down: LinkDirection = LinkDirection()

    def direction(self, direction: Direction) -> LinkProfile:
        """Return the impairment of one direction. Raises SettingsError where its values do not fit together."""
        values = {} if self.profile is None else PROFILES[self.profile].direction(direction)
        for name in LinkProfile.__struct_fields__:
            value = self._own(direction, name)
            if value is not None:
                values[name] = value
        check_outages(f"link.{direction}.", values.get("outage_s", 0.0), values.get("outage_every_s", 0.0))
        return LinkProfile(**values)

    def script(self, direction: Direction) -> Outages:
        """Return the outages by script of one direction: (start_s, length_s) of each. No welcome carries them."""
        found: Outages = self._own(direction, "outages") or ()
        return found

    def trace_of(self, direction: Direction) -> str:
        """Return the file of recorded delays of one direction, "" for none. No welcome carries it."""
        return self._own(direction, "trace") or ""

    @property
    def kept_back(self) -> tuple[str, ...]:
        """Keys in use that no welcome carries: a live session does not emulate them."""
        keys = ("outages", "trace")
        return tuple(f"link.{key}" for key in keys if self._own("up", key) or self._own("down", key))

    def _own(self, direction: Direction, name: str) -> Any:
        """Return a value of one direction, else of both; None where neither has any."""
        value = getattr(self.up if direction == "up" else self.down, name)
        return getattr(self, name) if value is None else value


def check_link(link: Link) -> None:
    """Check [link] as a whole. Raises SettingsError."""
    for where, part in (("link", link), ("link.up", link.up), ("link.down", link.down)):
        check_cap(f"{where}.rate_kbps", part.rate_kbps)
    for profile in (link.direction("up"), link.direction("down")):
        least = 1.0 / (1.0 - profile.loss)
        if profile.loss > 0.0 and profile.burst_frames > 1.0 and profile.burst_frames < least:
            raise SettingsError(
                f"link.burst_frames = {profile.burst_frames:g} is too short for link.loss = {profile.loss:g}: "
                f"bursts of at least {least:.3g} datagrams are needed"
            )
