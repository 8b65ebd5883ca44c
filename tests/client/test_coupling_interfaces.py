"""Couplings, decimators and a seated client have all that their bases only name."""

import pytest

from cogrip.client.coupling.interface import Coupling
from cogrip.client.coupling.local.local_contact import Contact, LocalCoupling
from cogrip.client.coupling.local.local_poses import PoseContact
from cogrip.client.coupling.local.local_scene import SceneContact
from cogrip.client.coupling.local.local_surface import Face, Surface, Wall
from cogrip.client.coupling.schemes import SCHEMES
from cogrip.machine.compiled_files import form
from cogrip.protocol.laws.decimation import Boxcar, Decimator, LastSample, Lowpass

from tests.interfaces import only_named

CONTACTS = (Wall, Face, SceneContact, PoseContact)  # `make_local` chooses one by the kind of object
COUPLINGS = (*[make for make in SCHEMES.values() if isinstance(make, type)], LocalCoupling)


@pytest.mark.skipif(form() != "interpreted", reason="a compiled method does not tell what it calls")
@pytest.mark.parametrize(
    ("base", "made"),
    [
        *((Coupling, made) for made in COUPLINGS),
        *((Contact, made) for made in CONTACTS),
        *((Surface, made) for made in (Wall, Face)),
        *((Decimator, made) for made in (Boxcar, Lowpass, LastSample)),
    ],
)
def test_nothing_is_left_to_the_base(base: type, made: type) -> None:
    named = only_named(base)
    assert named
    assert {name for name in named if getattr(made, name) is getattr(base, name)} == set()
