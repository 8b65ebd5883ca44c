"""[link]: what happens to the datagrams of one direction, as settings and as the two ends are told of it."""

from typing import Annotated

import msgspec

from cogrip.protocol.settings_table import SettingsError

Milliseconds = Annotated[float, msgspec.Meta(ge=0.0, le=10_000.0)]
Probability = Annotated[float, msgspec.Meta(ge=0.0, le=0.99)]
LEAST_KBPS = 1.0


def check_cap(path: str, rate_kbps: float | None) -> None:
    """Raises SettingsError for a cap that would hold a datagram for ever."""
    if rate_kbps and rate_kbps < LEAST_KBPS:
        raise SettingsError(f"{path} = {rate_kbps!r}: Expected float >= {LEAST_KBPS}, or 0 for no cap")


class LinkDirection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One direction's own values; what is None is taken from [link]."""

    delay_ms: Milliseconds | None = None
    jitter_ms: Milliseconds | None = None
    loss: Probability | None = None
    burst_frames: Annotated[float, msgspec.Meta(ge=1.0, le=1e4)] | None = None
    duplicate: Probability | None = None
    reorder: Probability | None = None
    rate_kbps: Annotated[float, msgspec.Meta(ge=0.0, le=1e7)] | None = None


class LinkProfile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, array_like=True):
    """What happens to the datagrams of one direction. rate_kbps = 0 means no cap, else at least LEAST_KBPS."""

    delay_ms: Milliseconds = 0.0
    jitter_ms: Milliseconds = 0.0
    loss: Probability = 0.0
    burst_frames: Annotated[float, msgspec.Meta(ge=1.0, le=1e4)] = 1.0
    duplicate: Probability = 0.0
    reorder: Probability = 0.0
    rate_kbps: Annotated[float, msgspec.Meta(ge=0.0, le=1e7)] = 0.0

    def __post_init__(self) -> None:
        check_cap("rate_kbps", self.rate_kbps)


class Link(LinkDirection, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """[link] holds for both directions; [link.up] (client to server) and [link.down] override it."""

    up: LinkDirection = LinkDirection()
    down: LinkDirection = LinkDirection()

    def direction(self, own: LinkDirection) -> LinkProfile:
        values: dict[str, float] = {}
        for name in LinkDirection.__struct_fields__:
            value = getattr(own, name)
            value = getattr(self, name) if value is None else value
            if value is not None:
                values[name] = value
        return LinkProfile(**values)
