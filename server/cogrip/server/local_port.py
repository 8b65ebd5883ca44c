"""Port of the scheme with local models: a wave port whose client also reports its proxy."""

from msgspec.structs import replace

from cogrip.protocol.messages import Waves
from cogrip.server.wave_port import WavePort


class LocalPort(WavePort):
    """proxy: of the newest frame [m], in the hand's own frame; None before the first."""

    def receive(self, message: Waves, now_ns: int) -> bool:
        axes = self.axes
        if len(message.state) != 3 * axes:
            return False
        newest = self._receiver.newest
        if not super().receive(replace(message, state=message.state[: 2 * axes]), now_ns):
            return False
        if self.proxy is None or self._receiver.newest > newest:
            self.proxy = message.state[2 * axes :]
        return True
