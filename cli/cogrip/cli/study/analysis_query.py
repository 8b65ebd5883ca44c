"""The query that the analysis commands share: settings, scheme, delays; and their notes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import (
    Form,
    LinearSession,
    ModelError,
    form_overrides,
    linear_session,
    rounding_notes,
)  # fmt: skip
from cogrip.cli.settings.settings_file import load
from cogrip.cli.terminal.output import Json, make_console
from cogrip.cli.terminal.parameters import Overrides
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import say
from cogrip.devices.device import DeviceError
from cogrip.protocol.settings.sections import Settings


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Query:
    """The linear session that a settings file stands for."""

    scheme: Annotated[
        Form | None,
        Parameter(
            help="Analyse it as this scheme; paper brings its filter (lowpass) and encoder (velocity). Else the file's."
        ),
    ] = None
    hands: Annotated[
        bool, Parameter(help="Let the simulated hands hold on; else devices are free, as in the paper.")
    ] = False
    estimated: Annotated[
        bool,
        Parameter(
            negative="--exact-velocity",
            help="Read the client's velocity estimate where a device gives none; --exact-velocity: the idealised session, "
            "with exact velocities, as in the paper.",
        ),
    ] = True

    overrides: Overrides = ()

    @property
    def conditions(self) -> str:
        """Return the conditions under which an answer holds."""
        velocity = "velocities as clients estimate them" if self.estimated else "idealised: exact velocities"
        hands = "simulated hands hold on" if self.hands else "nobody holds the devices"
        return f"{velocity}; {hands}; constant delays, lasting contact; no jitter, loss, friction or encoder steps"

    def settings(self, config: Path) -> Settings:
        """Return the file's settings as a session of the scheme; `--set` overrides both. Raises BadInput."""
        of_scheme = form_overrides(self.scheme) if self.scheme else {}
        flags = dict.fromkeys(of_scheme, f"--scheme {self.scheme}")
        return load(config, [*(f"{key}={value}" for key, value in of_scheme.items()), *self.overrides], flags=flags)

    @staticmethod
    def tell_rounding(*sessions: LinearSession) -> None:
        """Note on standard error how delays that are no whole number of ticks or frames were rounded."""
        console = make_console(stderr=True, soft_wrap=True)
        for note in dict.fromkeys(note for session in sessions for note in rounding_notes(session)):
            say(console, f"note: {note}")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ModelQuery(Query):
    """The lifted model of that session at one delay."""

    delay_frames: Annotated[
        float | None,
        Parameter(help="Delay of each direction in network frames, in place of the file's link and playout."),
    ] = None
    json: Json = None

    def model(self, config: Path) -> LiftedModel:
        """Return the model, and note how delays were rounded. Raises BadInput where there is none."""
        settings = self.settings(config)
        with BadInput.of(ModelError, DeviceError, where=f"{config}: "):
            session = linear_session(
                settings, delay_frames=self.delay_frames, hands=self.hands, estimated=self.estimated
            )
        self.tell_rounding(session)
        return LiftedModel(session)


AS_IT_STANDS = ModelQuery()
