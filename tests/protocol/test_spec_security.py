"""DTLS, budgets, join links and limits of a seat: SPEC.md and docs/security.md against the code."""

import re
from importlib import import_module
from typing import Any

import msgspec
import pytest

from cogrip.protocol.io import dtls
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.join_link import JoinLink, LinkError, parse_link
from cogrip.server.ports import seat_limits
from cogrip.server.ports.seat_limits import SeatLimits, WaveLimiter
from cogrip.server.rate_limit import LIMITS, Budget

from tests.protocol.spec_page import SECURITY, rows, section


def test_budgets_are_those_of_the_page() -> None:
    table = {row[0]: Budget(int(row[1]), int(row[2])) for row in rows(section("11.4"), "name")}
    assert table == LIMITS._asdict()


def test_suites_are_those_of_the_page_and_of_the_wire() -> None:
    """Parse a client's first datagram by hand: headers 13 and 12, version 2, random 32, session id, cookie."""
    table = rows(section("11.1"), "number")
    assert dtls.CIPHERS.decode() == ":".join(row[2] for row in table)
    association = dtls.Association(dtls.client_context("0" * 64, lambda _: None))
    association.connect()
    (hello,) = association.pop_datagrams()
    assert hello[25:27] == bytes.fromhex("fefd")
    assert hello[59:61] == b"\0\0"  # neither session id nor cookie
    size = int.from_bytes(hello[61:63], "big")
    offered = [hello[63 + at : 65 + at].hex() for at in range(0, size, 2)]
    assert [each for each in offered if each != "00ff"] == [row[0] for row in table]  # 00ff is no suite: RFC 5746
    assert hello[63 + size : 65 + size] == b"\x01\0"  # no compression
    assert max(int(row[3]) for row in table) == messages.DTLS_BYTES


MODULES = (
    "protocol.drawing", "protocol.secure.dtls_records", "protocol.line.receiver", "protocol.wire.messages",
    "protocol.recording.reader", "protocol.settings.room", "protocol.settings.sections",
    "server.administration.connection", "server.io.control", "server.io.datagram_path", "server.io.dtls_channel",
    "server.io.dtls_peer",
    "server.io.metrics_process", "machine.trial",
    "server.io.loop", "server.rate_limit", "server.room", "server.ports.seat_limits", "server.admission.tokens",
    "server.admission.token_keys", "server.admission.signed_tokens",
    "server.worlds.scenes.scene_file", "server.worlds.scenes.scene_text", "server.worlds.world",
    "view.io.page_server", "view.io.peer_log",
)  # fmt: skip


@pytest.mark.parametrize(("what", "numbers", "where"), rows(SECURITY.partition("## Numbers")[2], "what"))
def test_numbers_of_the_security_page_are_the_codes(what: str, numbers: str, where: str) -> None:
    modules = {name.rpartition(".")[2]: import_module(f"cogrip.{name}") for name in MODULES}
    found: list[float] = []
    for path in re.findall(r"`([\w.]+)`", where):
        first, *names = path.split(".")
        value: Any = modules[first]
        for name in names:
            default = isinstance(value, type) and issubclass(value, msgspec.Struct)
            value = getattr(value() if default else value, name)
        scale = 1e-9 if names[-1].endswith("_NS") else 1.0
        found += [scale * each for each in (value if isinstance(value, tuple) else (value,))]
    assert [float(number) for number in numbers.split(",")] == pytest.approx(found), what


FINGERPRINT, TOKEN = "0123456789abcdef" * 4, "AAECAwQFBgcICQoLDA0ODw"


def written_out(text: str) -> str:
    """A link of the page with f and t in full."""
    place, mark, secret = text.strip("`").partition("#")
    return place + mark + secret.replace("t", TOKEN).replace("f", FINGERPRINT)


@pytest.mark.parametrize(("link", "host", "port", "room", "form"), rows(section("15.5"), "link"))
def test_links_are_read_and_written_as_the_page_says(link: str, host: str, port: str, room: str, form: str) -> None:
    made = JoinLink(host, int(port), room, FINGERPRINT, TOKEN)
    assert parse_link(written_out(link)) == made
    assert made.text == written_out(link if form == "as it is" else form)


@pytest.mark.parametrize(("text", "why"), rows(section("15.5"), "text"))
def test_what_is_no_link_is_refused(text: str, why: str) -> None:
    with pytest.raises(LinkError):
        raise AssertionError(f"{why}: read as {parse_link(written_out(text))!r}")


def test_a_seat_brings_in_what_the_page_says() -> None:
    """The table of section 15.6, by the code and by the formulas of section 13."""
    b, force, speed, power, frame_s = 20.0, 8.0, 0.1, 0.1, 1 / 128
    limiter = WaveLimiter(b, frame_s, SeatLimits(force, speed, power))
    full = level = seat_limits.BURST_S * power
    before = 0.0
    for wave, applied, returned, level_j, counts in rows(section("15.6"), "wave"):
        u, v = float(wave), float(returned)
        bound = min(((b * speed + force) / (2 * b) ** 0.5) ** 2, before**2 + max(0.0, level) / (frame_s / 2))
        expected = u * min(1.0, (bound / u**2) ** 0.5) if u else 0.0
        level = min(full, level + power * frame_s - (expected**2 - v**2) * frame_s / 2)
        before = v
        assert float(applied) == pytest.approx(expected, abs=1e-12)
        assert float(level_j) == pytest.approx(level, abs=1e-12)
        (let,) = limiter.limit((u,))
        limiter.book((v,))
        assert let == pytest.approx(expected, abs=1e-12)
        assert [limiter.counts.get(name, 0) for name in ("wave clipped", "power limited")] == [
            int(count) for count in counts.split()
        ]
