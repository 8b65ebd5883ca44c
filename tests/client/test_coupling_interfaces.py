"""Couplings and decimators have all that their bases only name."""

import pytest

from cogrip.client.coupling import Coupling
from cogrip.client.local_contact import LocalFaces, LocalWall
from cogrip.client.local_poses import LocalPoses
from cogrip.client.local_scene import LocalScene
from cogrip.client.passivity_control import PassivityControl
from cogrip.client.virtual_coupling import VirtualCoupling
from cogrip.client.wave_coupling import WaveCoupling
from cogrip.protocol.compiled import form
from cogrip.protocol.decimation import Boxcar, Decimator, LastSample, Lowpass

from tests.interfaces import only_named

COUPLINGS = (WaveCoupling, VirtualCoupling, PassivityControl, LocalWall, LocalFaces, LocalScene, LocalPoses)


@pytest.mark.skipif(form() != "interpreted", reason="a compiled method does not tell what it calls")
@pytest.mark.parametrize(
    ("base", "made"),
    [*((Coupling, made) for made in COUPLINGS), *((Decimator, made) for made in (Boxcar, Lowpass, LastSample))],
)
def test_nothing_is_left_to_the_base(base: type, made: type) -> None:
    named = only_named(base)
    assert named
    assert {name for name in named if getattr(made, name) is getattr(base, name)} == set()
