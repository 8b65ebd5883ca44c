"""Tokens as a worker knows them: the front, which has the file, sends its verdict with each hello, and what became void."""

from cogrip.protocol.wire.messages import Hello
from cogrip.server.admission.admission import Denied, Grant
from cogrip.server.hosting.link import ProcessLink, RevokeToken, SeatGiven

NO_VERDICT = Denied("token", "the server has not looked at this token; join again")


class FrontVerdicts:
    """`Authenticator` of a worker. newest: verdict on the message that the sockets returned last; newest_shown: its token."""

    def __init__(self, link: ProcessLink) -> None:
        self.not_written = ""  # the front has the file
        self.newest: Grant | Denied | None = None
        self.newest_shown: str | None = None
        self._link = link
        self._revoked: set[str] = set()
        self._expired: set[str] = set()

    def admit(self, hello: Hello) -> Grant | Denied:
        """See `Authenticator`."""
        verdict, self.newest = self.newest, None
        return verdict or NO_VERDICT

    def shown(self, hello: Hello) -> str | None:
        """See `Authenticator`."""
        return self.newest_shown

    def admitted(self, grant: Grant) -> None:
        """See `Authenticator`."""
        self._link.send(SeatGiven(grant))

    def void(self, revoked: tuple[str, ...], expired: tuple[str, ...]) -> None:
        """Note ids of tokens that are void from now on."""
        self._revoked.update(revoked)
        self._expired.update(expired)

    def revoke_room(self, room: str) -> None:
        """Do nothing: the front hears that the room is closed."""

    def revoke(self, ident: str) -> None:
        """Let the front revoke a token."""
        self._link.send(RevokeToken(ident))

    def revoked(self) -> set[str]:
        """Return the ids of tokens revoked since the last call."""
        news, self._revoked = self._revoked, set()
        return news

    def expired(self) -> set[str]:
        """Return the ids of tokens whose time has ended since the last call."""
        news, self._expired = self._expired, set()
        return news

    def reload(self) -> bool:
        """Return True: the front reads the file."""
        return True

    def read_on(self) -> None:
        """Do nothing: the front reads the file."""

    def close(self) -> None:
        """Do nothing: the front has the file."""
