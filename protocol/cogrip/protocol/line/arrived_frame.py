"""A frame that has come and is not due yet."""

from cogrip.protocol.line.received_waves import ReceivedWaves
from cogrip.protocol.line.sender import Frame


class ArrivedFrame:
    """Wave of a frame, and the sender's ledger up to it, which comes with the newest frame of a datagram (SPEC 9).

    wave            shape (axes,) [sqrt(W)]
    has_ledger      a datagram ended with this frame, so that the others are known
    made_j, port_j  energy into the line, and at its sender's port [J]
    acknowledged    number after the frame that its sender had popped last
    """

    __slots__ = ("acknowledged", "has_ledger", "made_j", "port_j", "wave")

    def __init__(self, wave: Frame) -> None:
        self.wave = wave
        self.has_ledger = False
        self.made_j = self.port_j = 0.0
        self.acknowledged = 0

    def set_ledger(self, datagram: ReceivedWaves) -> None:
        """Take the ledger of the datagram that ends with this frame."""
        self.has_ledger = True
        self.made_j, self.port_j, self.acknowledged = datagram.made_j, datagram.port_j, datagram.acknowledged
