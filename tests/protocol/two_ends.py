"""A client's session and a server, and the words between them."""

from itertools import count

import msgspec

from cogrip.protocol.settings.room import resolve
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Hello, Stamp, Waves
from cogrip.protocol.wire.session import ClientSession, make_hello
from cogrip.server.admission.admission import AdmissionServices
from cogrip.server.core import ServerCore

MS = 1_000_000
SETTINGS = resolve({"name": "lab", "users": [{"name": "anna"}, {"name": "ben", "side": "right"}]})


def hello(name: str = "anna", nonce: int = 7, **other: object) -> Hello:
    made = make_hello(
        software="1", nonce=nonce, room="lab", name=name, digest="", device="sim:phantom", axes=1, rate_hz=1024.0
    )
    return msgspec.structs.replace(made, **other)


def server(tickets: bool = False, first_session: int = 100) -> ServerCore:
    """Sessions are numbered from `first_session`, tickets are called ticket-1, ticket-2 ..., where there are any."""
    numbers, made = count(first_session), count(1)
    services = AdmissionServices(lambda: next(numbers), new_ticket=lambda: f"ticket-{next(made)}" if tickets else "")
    return ServerCore([SETTINGS], "1", services)


def waves(session: int, number: int = 0) -> bytes:
    return messages.encode(Waves(session, number, (0.0,), (0.0,), (0.0,), 0.0, 0.0, 0, Stamp(1), (0.0, 0.0)))


def exchange(client: ClientSession, core: ServerCore, now_ns: int, address: str = "anna's") -> None:
    while client.outbox:
        core.receive(client.outbox.popleft(), address, now_ns)
    while core.outbox:
        to, datagram = core.outbox.popleft()
        if to == address:
            client.receive(datagram, now_ns)


def answered(asked: Hello, core: ServerCore, now_ns: int = 0, address: str = "anna's") -> ClientSession:
    """Return the session of a client whose hello the server has answered."""
    client = ClientSession(asked)
    client.connect(now_ns)
    exchange(client, core, now_ns, address)
    return client


def seated(now_ns: int = 0, tickets: bool = False) -> tuple[ClientSession, ServerCore]:
    core = server(tickets)
    client = answered(hello(), core, now_ns)
    assert client.state == "seated"
    return client, core
