"""The conformance suite of worlds for waves: what each promises, as checks. `for check in CHECKS: check(Subject(make))`.

A check raises UnfitError, which says what was expected and what was found, and returns what it measured, or "". `cogrip worlds
check` runs all of them. The world stands alone in them, without the guard that bounds what it gives out in a room.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from math import hypot, inf, isfinite, nan, pi
from typing import Any

import numpy as np

from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.laws.rotations import Quaternion, between, exp, log, product
from cogrip.server.worlds.guarded import LEAST_J, MOST_HELD_J, MOST_SAVED, MOST_WAVE
from cogrip.server.worlds.orientation_drift import SHARE
from cogrip.server.worlds.world import Array, World, WorldError, displacement, dot

SESSIONS = 12
FRAMES = 640  # number of frames of a session: 5 s at 128 Hz
ALONE_FROM, ALONE_TO = 400, 540  # frames in which nobody holds anything
MOST_MADE_J = 1e-5  # most energy that a world may make in any stretch of a session
SAME_M = 1e-9
SUBSTEPS_RAD = 1e-4  # largest difference between a turn in steps and one at their mean rate
MOST_DRIFT_RAD = 0.1
COST_FRAMES = 1000
FRAME_SHARE = 0.5  # share of a frame that p99 of a step may take: the server has more to do
REACHES_M = (0.0, 0.03, -0.05)  # places of a hand when it takes hold, in turn
MOST_TURNED_RAD = pi  # largest angle by which a hand is turned when it takes hold


class UnfitError(AssertionError):
    """A world does not keep a promise."""


@dataclass(frozen=True, slots=True)
class Subject:
    """The world under test.

    make        a new world that nobody holds
    time_limit  bounds the time of each step
    clocks      of the wall and of the processor [ns], by which steps are timed; None: they take none
    uncounted   energy that springs hold and give back, which the world's own leaves out, less what came in beside the waves [J]
    """

    make: Callable[[], World]
    time_limit: Callable[[], AbstractContextManager[None]] = nullcontext
    clocks: tuple[Callable[[], int], Callable[[], int]] | None = None
    uncounted: Callable[[World], float] = lambda _: 0.0


class TurningHands:
    """Hands that turn, as their clients report them: how each is turned, and the angle travelled since it took hold.

    A hand goes as its line has it: by T (u + v) / sqrt(2 b_r) in a frame, u the wave that it sends, v the one that came last.
    """

    def __init__(self, world: World) -> None:
        seats = len(world.holding)
        self._world = world
        self.reported = world.axes == POSE_AXES and type(world).set_reported_rotation is not World.set_reported_rotation
        self._turned: list[Quaternion] = [exp((0.0,) * PLACES)] * seats
        self._travelled = np.zeros((seats, PLACES))

    def of(self, world: World) -> "TurningHands":
        """Return hands that are as these are now, at another world."""
        hands = TurningHands(world)
        hands._turned, hands._travelled = self._turned.copy(), self._travelled.copy()
        return hands

    def join(self, user: int, rotation_rad: Sequence[float]) -> None:
        """Let one take hold, turned like this."""
        self._turned[user] = exp(rotation_rad)
        self._travelled[user] = 0.0

    def move(self, waves: Array) -> None:
        """Go on by a frame, and report it. waves: u + v of each seat and axis."""
        world = self._world
        if not self.reported:
            return
        steps = world.frame_s * waves[:, PLACES:] / np.sqrt(2.0 * world.port_impedance[:, PLACES:])
        self._travelled += steps
        for user in np.flatnonzero(world.holding).tolist():
            self._turned[user] = product(exp(steps[user].tolist()), self._turned[user])
            world.set_reported_rotation(user, log(self._turned[user]), tuple(self._travelled[user].tolist()))

    def away(self, user: int, tool_travelled_rad: Array) -> float:
        """Return by what angle a proxy is turned away from its hand, but for the stretch of the line [rad]."""
        stretch = exp((tool_travelled_rad - self._travelled[user]).tolist())
        proxy = exp(self._world.proxy_of(user)[PLACES:])
        return hypot(*between(product(stretch, self._turned[user]), proxy))


class AdversarySession:
    """A world, and adversaries at its seats: noise, slow and fast swings, and ends that send back what comes, or its negative.

    The same seed gives the same waves, as long as the world answers the same. People take hold turned in any way.
    """

    def __init__(
        self, subject: Subject, seed: int, world: World | None = None, hands: TurningHands | None = None
    ) -> None:
        self.world = subject.make() if world is None else world
        self.hands = TurningHands(self.world) if hands is None else hands.of(self.world)
        self._subject = subject
        self._random = random = np.random.default_rng(seed)
        self.shape = len(self.world.holding), self.world.axes
        self._manner = random.integers(0, 5, self.shape[0])
        self._size = 10.0 ** random.uniform(-1.5, 0.0, (self.shape[0], 1))  # sqrt(W)
        self._radians = random.uniform(0.01, 1.5, (self.shape[0], 1))  # a frame
        self.frame = 0
        self.sent, self.back = np.zeros((2, *self.shape))
        self._begins = np.zeros((self.shape[0], 1), dtype=bool)  # whose hand rests for a frame

    def join(self, user: int) -> None:
        """Let one person take hold."""
        pose = np.full(self.shape[1], REACHES_M[user % len(REACHES_M)])
        if self.shape[1] == POSE_AXES:
            axis = self._random.normal(size=PLACES)
            pose[PLACES:] = self._random.uniform(0.0, MOST_TURNED_RAD) * axis / np.linalg.norm(axis)
            self.hands.join(user, pose[PLACES:].tolist())
            self._begins[user] = self.hands.reported  # from rest, else its first report would be of a stretched line
        self.back[user] = 0.0  # nothing has come yet
        self.world.join(user, pose)

    def hold(self) -> "AdversarySession":
        """Let everybody take hold. Returns itself."""
        for user in range(self.shape[0]):
            self.join(user)
        return self

    def step(self) -> list[list[float]]:
        """Step the world by one frame. Returns what it answered."""
        self.sent = self._waves() if self.world.holding.any() else np.zeros(self.shape)
        self.hands.move(self.sent + self.back)
        rows: list[Any] = self.sent.tolist()
        given = [row.copy() for row in rows]
        with self._subject.time_limit():
            answers = self.world.advance(rows)
        _expect(rows == given, "advance does not write into the rows that it is given")
        back = np.array(answers, dtype=float)
        _expect(back.shape == self.shape, f"advance gives a row of {self.shape[1]} waves a seat, not {back.shape}")
        if not np.all(np.abs(back) <= MOST_WAVE):  # the text alone would take longer than the step
            raise UnfitError(f"waves are finite, at most {MOST_WAVE:g}: {back.ravel()[:6]}")
        self.back = np.where(self.world.holding[:, None], back, 0.0)
        self.frame += 1
        return [list(row) for row in answers]

    def _waves(self) -> Array:
        noise = self._random.normal(size=self.shape)
        # each axis at a phase of its own: rotations about axes that change do not commute
        swing = np.sin(self._radians * self.frame + np.arange(self.shape[1])) * np.sign(noise[:, :1] + 2.0)
        kick = 4.0 if self.frame % 97 == 0 else 0.0
        manners = (noise, swing, np.sign(swing))
        u = np.choose(np.minimum(self._manner, 2)[:, None], manners) * self._size
        for manner, sign in ((3, 1.0), (4, -1.0)):  # ends that lose nothing
            u = np.where((self._manner == manner)[:, None], sign * self.back + kick * self._size, u)
        goes = self.world.holding[:, None] & ~self._begins
        self._begins[:] = False
        return np.where(goes, np.clip(u, -4.0, 4.0), 0.0)

    @property
    def came_j(self) -> float:
        """Energy that came in at the ports in the last step."""
        return 0.5 * self.world.frame_s * (dot(self.sent, self.sent) - dot(self.back, self.back))

    def state(self) -> tuple[object, ...]:
        """Return everything that can be seen of the world."""
        world = self.world
        seats = [(world.proxy_of(user), world.force_of(user)) for user in range(self.shape[0])]
        return world.motion(), seats, world.energy_j, tuple(world.port_work_j()), world.save()

    def course(self, frames: int) -> list[tuple[object, ...]]:
        """Return answers and state of each of the next frames."""
        return [(self.step(), self.state()) for _ in range(frames)]


def counts_its_energy(subject: Subject) -> str:
    """Finite, never below 0, and little at first: people may get it."""
    energy = subject.make().energy_j
    _expect(0.0 <= energy <= MOST_HELD_J, f"energy_j is from 0 to {MOST_HELD_J:g} J at first: {energy}")
    for session in _sessions(subject, 4):
        for _ in range(200):
            session.step()
            energy = session.world.energy_j
            _expect(isfinite(energy) and energy >= LEAST_J, f"energy_j is finite and never below 0: {energy}")
    return ""


def makes_no_energy(subject: Subject) -> str:
    """In no stretch of any session does the world's energy grow by more than what came in at the ports."""
    worst, moment = 0.0, (0, 0)
    for seed in range(SESSIONS):
        session = AdversarySession(subject, seed).hold()
        world, made, least = session.world, 0.0, 0.0
        energy = world.energy_j + subject.uncounted(world)
        for frame in range(FRAMES):
            if frame in (ALONE_FROM, ALONE_TO):
                for user in range(session.shape[0]):
                    world.leave(user) if frame == ALONE_FROM else session.join(user)
            session.step()
            before, energy = energy, world.energy_j + subject.uncounted(world)
            made += energy - before - session.came_j
            if made - least > worst:
                worst, moment = made - least, (seed, frame)
            least = min(least, made)
            if worst > MOST_HELD_J:
                break
    _expect(
        worst <= MOST_MADE_J,
        f"at most {1e3 * MOST_MADE_J:g} mJ more than came in: {1e3 * worst:.4g} mJ by frame {moment[1]} of session "
        f"{moment[0]}; step it by an implicit rule, and count all of its energy",
    )
    return f"worst stretch {1e3 * worst:.2g} mJ"


def proxies_follow_their_waves(subject: Subject) -> str:
    """A proxy moves by T (u + v) / sqrt(2b) in a frame, as the hand at the other end does; it turns with b_r for b.

    Where a world takes in how hands are turned (theory 8.5), a proxy is turned back as well, by a share of what it has drifted.
    """
    for session in _sessions(subject, 4):
        world, hands, users = session.world, session.hands, range(session.shape[0])
        gain = world.frame_s / np.sqrt(2.0 * world.port_impedance)
        before, allowed = _proxies(world), np.full(session.shape, SAME_M)
        travelled = np.zeros(session.shape)
        for _ in range(200):
            if hands.reported:
                drift_rad = np.array([hands.away(user, travelled[user, PLACES:]) for user in users])
                _expect(
                    bool(np.all(drift_rad <= MOST_DRIFT_RAD)),
                    f"proxies are turned as their hands, within {MOST_DRIFT_RAD:g} rad: {drift_rad.max():.3g} apart",
                )
                allowed[:, PLACES:] = SUBSTEPS_RAD + SHARE * drift_rad[:, None]
            session.step()
            now, moved = _proxies(world), gain * (session.sent + session.back)
            away = np.abs(displacement(before, now) - moved)
            _expect(
                bool(np.all(away <= allowed)),
                f"proxies move as their waves say, within {SAME_M:g} m (rad) a frame: {away.max():.3g} apart",
            )
            before, travelled = now, travelled + moved
    return ""


def joins_and_leaves(subject: Subject) -> str:
    """Taking hold puts the proxy where the hand is, moves nobody else's, and brings no energy; letting go brings none."""
    world = subject.make()
    users = range(len(world.holding))
    for number, place in enumerate((*REACHES_M, 0.11)):
        for user in users:
            before, energy = _proxies(world), world.energy_j
            hand = np.full(world.axes, place)
            hand[PLACES:POSE_AXES] *= 10.0  # rad
            world.join(user, hand.copy())
            _expect(bool(world.holding[user]), "holding is true for who has taken hold")
            after = _proxies(world)
            _expect(_near(after[user], hand), f"the proxy is at the hand, {hand} m: {after[user]} m")
            others = [each for each in users if each != user]
            _expect(_near(after[others], before[others]), "nobody else's proxy moves when somebody takes hold")
            more_j = world.energy_j - energy
            _expect(more_j <= 1e-9, f"taking hold brings no energy: {more_j:.3g} J")
        for _ in range(20):
            world.advance([(0.02 * (number - 1),) * world.axes for _ in users])
        for user in users:
            energy = world.energy_j
            world.leave(user)
            _expect(not world.holding[user], "holding is false for who has let go")
            more_j = world.energy_j - energy
            _expect(more_j <= 1e-9, f"letting go brings no energy: {more_j:.3g} J")
            world.advance([(0.0,) * world.axes for _ in users])
    return ""


def gives_the_same_again(subject: Subject) -> str:
    """The same inputs give the same bits, also where another world of the kind is stepped in between."""
    alone = AdversarySession(subject, 1).hold().course(120)
    one, other = AdversarySession(subject, 1).hold(), AdversarySession(subject, 2).hold()
    for number, expected in enumerate(alone):
        found = one.course(1)[0]
        _expect(found == expected, f"the same bits as alone, with another world beside it: frame {number} differs")
        other.step()
    return ""


def keeps_what_it_answered(subject: Subject) -> str:
    """An answer, and positions that were read, do not change with later steps."""
    session = AdversarySession(subject, 3).hold()
    world = session.world
    for _ in range(20):
        rows: list[Any] = session.sent.tolist()
        answers, position, proxy = world.advance(rows), world.position, world.proxy(0)
        before = ([list(row) for row in answers], position.tolist(), proxy.tolist())
        session.step()
        after = ([list(row) for row in answers], position.tolist(), proxy.tolist())
        _expect(before == after, "what was returned stays as it was when the next step is made: return new arrays")
    return ""


def restores_bit_for_bit(subject: Subject) -> str:
    """A new world, and one that has gone elsewhere, go on from a saved state with the same bits. To save changes nothing."""
    saved: Row = ()
    for seed, frames, left in ((0, 0, None), (1, 90, None), (2, 150, 0), (3, 37, None)):
        session = AdversarySession(subject, seed).hold()
        session.course(frames)
        if left is not None:
            session.world.leave(left)
        saved = session.world.save()
        _expect(saved == session.world.save(), "save gives the same twice")
        _expect(len(saved) <= MOST_SAVED, f"save gives at most {MOST_SAVED} numbers: {len(saved)}")
        hands = session.hands.of(session.world)
        expected = AdversarySession(subject, seed + 50, session.world, hands).course(150)
        elsewhere = AdversarySession(subject, seed + 100).hold()
        elsewhere.course(60)
        for name, world in (("a new world", subject.make()), ("a world that was elsewhere", elsewhere.world)):
            world.restore(saved)
            _expect(world.save() == saved, f"{name} that is restored saves the same")
            for number, (found, wanted) in enumerate(
                zip(AdversarySession(subject, seed + 50, world, hands).course(150), expected, strict=True)
            ):
                _expect(
                    found == wanted,
                    f"{name} goes on with the same bits: frame {number} after restore differs; is all that changes in `kept`?",
                )
    return f"{len(saved)} numbers"


def refuses_other_states(subject: Subject) -> str:
    """Numbers that are none, or too few or many: WorldError, and nothing has changed."""
    session = AdversarySession(subject, 4).hold()
    session.course(30)
    world = session.world
    saved = world.save()
    _expect(all(map(isfinite, saved)), "what is saved is finite")
    places = sorted({int(place) for place in np.linspace(0, len(saved) - 1, 24)})
    spoiled: list[Row] = [(*saved[:at], bad, *saved[at + 1 :]) for at in places for bad in (nan, inf)]
    for state in (*spoiled, saved[:-1], (*saved, 0.0), ()):
        try:
            world.restore(state)
        except WorldError:
            _expect(world.save() == saved, "a state that is refused changes nothing")
        else:
            raise UnfitError("restore raises WorldError for numbers that are not finite, and for too few or too many")
    return ""


def keeps_time(subject: Subject) -> str:
    """A step takes less than half a frame of the processor 99 times of 100, and of the clock every other time.

    Another program that takes the processor away is not the world's fault; a world that sleeps is slow all the same.
    """
    if subject.clocks is None:
        return ""
    session = AdversarySession(subject, 5).hold()
    took_us = []
    for _ in range(COST_FRAMES):
        session.step()
        rows: list[Any] = session.sent.tolist()
        start = [clock() for clock in subject.clocks]
        session.world.advance(rows)
        took_us.append([1e-3 * (clock() - before) for clock, before in zip(subject.clocks, start, strict=True)])
    wall_us, processor_us = np.array(took_us).T
    p50_us, p99_us = float(np.median(wall_us)), float(np.percentile(processor_us, 99))
    frame_us = 1e6 * session.world.frame_s
    measured = f"p50 {p50_us:.0f} us, p99 {p99_us:.0f} us of the processor, of a frame of {frame_us:.0f} us"
    _expect(
        max(p50_us, p99_us) <= FRAME_SHARE * frame_us, f"a step takes at most {FRAME_SHARE:g} of a frame: {measured}"
    )
    return measured


CHECKS: tuple[Callable[[Subject], str], ...] = (
    counts_its_energy, makes_no_energy, proxies_follow_their_waves, joins_and_leaves, gives_the_same_again,
    keeps_what_it_answered, restores_bit_for_bit, refuses_other_states, keeps_time,
)  # fmt: skip


def _sessions(subject: Subject, count: int) -> Iterator[AdversarySession]:
    return (AdversarySession(subject, seed).hold() for seed in range(count))


def _proxies(world: World) -> Array:
    return np.array([world.proxy_of(user) for user in range(len(world.holding))])


def _near(found: Array, wanted: Array | Sequence[float]) -> bool:
    return bool(np.all(np.abs(found - wanted) <= SAME_M))


def _expect(kept: bool, promise: str) -> None:
    if not kept:
        raise UnfitError(promise)
