"""Ports and jitter buffers have all that their bases only name: a compiled base cannot ask for it as an abstract class does."""

import pytest

from cogrip.machine.compiled_files import form
from cogrip.protocol.line.jitter_buffer import AdaptiveJitterBuffer, FixedJitterBuffer, JitterBuffer
from cogrip.server.ports.port import Port
from cogrip.server.schemes import SCHEMES

from tests.interfaces import only_named

PORTS = sorted({scheme.make_port for scheme in SCHEMES.values()}, key=lambda port: port.__name__)


@pytest.mark.skipif(form() != "interpreted", reason="a compiled method does not tell what it calls")
@pytest.mark.parametrize(
    ("base", "made"),
    [*((Port, port) for port in PORTS), (JitterBuffer, FixedJitterBuffer), (JitterBuffer, AdaptiveJitterBuffer)],
)
def test_nothing_is_left_to_the_base(base: type, made: type) -> None:
    named = only_named(base)
    assert named
    assert {name for name in named if getattr(made, name) is getattr(base, name)} == set()


@pytest.mark.skipif(form() != "interpreted", reason="a compiled method does not tell what it calls")
def test_what_is_left_is_found() -> None:
    class Lacking(FixedJitterBuffer):
        decide = JitterBuffer.decide

    assert {name for name in only_named(JitterBuffer) if getattr(Lacking, name) is getattr(JitterBuffer, name)} == {
        "decide"
    }
