cimport cython

from cogrip.protocol.button_edges cimport EdgeReceiver
from cogrip.server.participants cimport Seat
from cogrip.server.port cimport Port
from cogrip.server.room cimport Room


@cython.locals(seat=Seat, port=Port, handle=EdgeReceiver)
cdef _seat_step(Room room, Py_ssize_t number)
