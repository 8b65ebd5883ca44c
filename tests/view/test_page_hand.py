"""The hand of the page in a real browser: what pointer, finger and gamepad say, and where the device is drawn."""

from collections.abc import Iterator
from dataclasses import replace
from math import hypot

import pytest

from cogrip.devices.web.messages import OwnHand, Pointer, decode_pointer, encode_own_hand
from cogrip.machine.rows import Vector
from cogrip.view.frames import encode
from cogrip.view.scene import to_json

from tests.view.browser_page import BrowserPage, Show, Shown
from tests.view.page_server import PageServer
from tests.view.pictured import anchor, frame, scene

AT = (0.02, 0.03, 0.04)


def seen(place_m: Vector) -> list[float]:
    """Return where the device of a place is drawn: where its hand holds the object."""
    return [value + held for value, held in zip(place_m, anchor(0, 2), strict=True)]


DRAWN = seen(AT)
GAMEPAD = """() => {
  globalThis.rumbles = [];
  const pad = { connected: true, axes: [0, 0, 0, 0], buttons: Array.from({ length: 16 }, () => ({ pressed: false })),
    vibrationActuator: { playEffect: async (...effect) => rumbles.push(effect) } };
  navigator.getGamepads = () => [null, pad];
  globalThis.pad = pad;
}"""


class Held:
    """A page with a hand, whose device is at `AT`."""

    def __init__(self, page: BrowserPage, server: PageServer) -> None:
        self.page, self.server = page, server
        self.said: list[Pointer] = []
        server.send(encode(frame(1)))
        self.own_hand(AT)
        page.until("cogrip.hand.own !== null && cogrip.frame !== null")

    def own_hand(self, position_m: Vector, force_n: Vector = (0.5, 0.0, 0.0)) -> None:
        self.server.send(encode_own_hand(OwnHand("live", 0, position_m, force_n, 3.0)))

    def next(self) -> Pointer:
        message = self.server.said.get(timeout=10)
        assert isinstance(message, bytes)
        self.said.append(decode_pointer(message))
        return self.said[-1]

    def until_released(self) -> list[Pointer]:
        """Return all messages up to the one that lets go."""
        while self.next().holds:
            pass
        return self.said

    def until_buttons(self, buttons: int) -> None:
        while self.next().buttons != buttons:
            pass

    def press(self) -> list[float]:
        x, y = self.page.state(f"cogrip.project({DRAWN})")
        self.page.tab.mouse.move(x, y)
        self.page.tab.mouse.down()
        return [x, y]


@pytest.fixture(scope="module")
def opened(show_shared: Show) -> Shown:
    page, server = show_shared(scene(hand=True), more="&hand")
    assert server.hellos.get()["hand"] is True
    return page, server


@pytest.fixture
def hand(opened: Shown) -> Iterator[Held]:
    """The page that all tests share, seen as at first, with a new socket: it holds nothing and has said nothing."""
    page, server = opened
    page.tab.keyboard.press("4")
    server.come_again()
    yield Held(page, server)
    page.tab.mouse.up()
    for key in "79":  # a test that failed holds nothing for the next one
        page.tab.keyboard.up(key)
    page.state("delete navigator.getGamepads")


def test_drag_says_where_the_device_is_to_go(hand: Held) -> None:
    x, y = hand.press()
    hand.page.tab.mouse.move(x + 60, y - 40, steps=5)
    hand.page.tab.mouse.up()
    said = hand.until_released()
    assert [each.number for each in said] == list(range(1, len(said) + 1))
    assert said[0].target_m == pytest.approx(AT, abs=1e-12), "pressing moves nothing"
    assert [each.holds for each in said] == [True] * (len(said) - 1) + [False]
    assert hand.page.state(f"cogrip.project({seen(said[-2].target_m)})") == pytest.approx([x + 60, y - 40], abs=0.01)
    assert said[-1].target_m == said[-2].target_m


def test_device_is_drawn_where_the_process_says_and_not_at_the_pointer(hand: Held) -> None:
    x, y = hand.press()
    hand.page.tab.mouse.move(x + 100, y)
    behind = (0.021, 0.031, 0.039)
    hand.own_hand(behind, (-2.0, 0.0, 0.0))
    wanted = seen(behind)
    hand.page.until(f"cogrip.frame.drawn.people[0].hand[0] === {wanted[0]}")
    assert hand.page.state("cogrip.frame.drawn.people[0].hand") == wanted
    assert hypot(*[a - b for a, b in zip(hand.page.state("cogrip.hand.target_m"), behind, strict=True)]) > 0.01
    hand.page.until("document.getElementById('own-force').textContent.startsWith('force on your hand 2.00 of 3.0 N')")
    hand.page.tab.mouse.up()


def test_pointer_that_rests_is_said_again_and_again(hand: Held) -> None:
    hand.press()
    first = hand.next()
    for _ in range(5):
        assert replace(hand.next(), number=first.number) == first
    hand.page.tab.mouse.up()
    hand.until_released()


def test_wheel_moves_the_target_away_and_stays_below_the_pointer(hand: Held) -> None:
    hand.press()
    first = hand.next()
    hand.page.tab.mouse.wheel(0, -200)
    hand.page.until("cogrip.hand.sent > 2")
    while (now := hand.next()).target_m == first.target_m:
        pass
    moved = [after - before for after, before in zip(now.target_m, first.target_m, strict=True)]
    assert hypot(*moved) == pytest.approx(0.04, rel=1e-6)
    assert moved[0] < 0 < moved[1], "away from a camera in front, at the left"
    hand.page.tab.mouse.up()


@pytest.mark.parametrize("event", ["blur", "pagehide"])
def test_window_that_loses_the_user_lets_go(hand: Held, event: str) -> None:
    hand.press()
    assert hand.next().holds
    hand.page.state(f"window.dispatchEvent(new Event('{event}'))")
    assert not hand.until_released()[-1].holds
    hand.page.tab.mouse.move(10, 200)
    assert hand.page.state("cogrip.hand.target_m") is None, "until it is pressed again"


def test_hidden_tab_lets_go(hand: Held) -> None:
    changed = "document.dispatchEvent(new Event('visibilitychange'))"
    hand.press()
    hand.page.state(f"Object.defineProperty(document, 'hidden', {{ get: () => true, configurable: true }}), {changed}")
    assert not hand.until_released()[-1].holds
    hand.page.state(f"delete document.hidden, {changed}")


def test_press_beside_device_and_object_turns_the_camera(hand: Held) -> None:
    before = hand.page.state(f"cogrip.project({DRAWN})")
    hand.page.tab.mouse.move(60, 600)
    hand.page.tab.mouse.down()
    hand.page.tab.mouse.move(120, 600)
    hand.page.tab.mouse.up()
    assert hand.page.state("cogrip.hand.sent") == 0
    assert hand.page.state(f"cogrip.project({DRAWN})") != before


def test_object_can_be_pressed_as_well(hand: Held) -> None:
    x, y = hand.page.state("cogrip.project([0.0, 0.0, 0.0])")
    hand.page.tab.mouse.move(x, y)
    hand.page.tab.mouse.down()
    assert hand.next().target_m == pytest.approx(AT, abs=1e-12)
    hand.page.tab.mouse.up()


def test_one_axis_is_pulled_along_x(hand: Held) -> None:
    hand.server.send(to_json(scene(axes=1, hand=True)))
    hand.page.until("cogrip.scene.axes === 1")
    x, y = hand.press()
    hand.page.tab.mouse.move(x + 50, y + 30)
    hand.page.tab.mouse.up()
    target = hand.until_released()[-1].target_m
    assert target[0] > AT[0] + 0.005
    assert target[1:] == (0.0, 0.0)


def test_finger_pulls_and_its_end_lets_go(show: Show) -> None:
    page, server = show(scene(hand=True), more="&hand", width=390, height=844, has_touch=True)
    held = Held(page, server)
    x, y = page.state(f"cogrip.project({DRAWN})")
    touch = page.context.new_cdp_session(page.tab)
    for kind, points in (("Start", [(x, y)]), ("Move", [(x + 30, y)]), ("Move", [(x + 45, y - 20)]), ("End", [])):
        spots = [{"x": column, "y": row} for column, row in points]
        touch.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": spots})
    said = held.until_released()
    assert page.state(f"cogrip.project({seen(said[-1].target_m)})") == pytest.approx([x + 45, y - 20], abs=1.0)


def test_keys_and_gamepad_are_buttons_of_the_hand(hand: Held) -> None:
    """Bit k is button k + 1. The keys 1 to 4 turn the picture, and a gamepad's buttons 1, 5 and 6 hold."""
    keyboard = hand.page.tab.keyboard
    keyboard.down("7")
    keyboard.down("9")
    while hand.next().buttons != 1 << 6 | 1 << 8:  # the first alone is said again where the second comes later
        assert hand.said[-1].buttons == 1 << 6
    assert hand.said[0].buttons == 1 << 6
    assert not hand.said[-1].holds
    keyboard.up("7")
    hand.until_buttons(1 << 8)
    keyboard.up("9")
    hand.until_buttons(0)
    hand.page.state(GAMEPAD)
    hand.page.state("pad.buttons[2].pressed = pad.buttons[15].pressed = true")
    hand.until_buttons(1 << 2 | 1 << 15)
    hand.page.state("pad.buttons[2].pressed = pad.buttons[15].pressed = false")
    hand.until_buttons(0)
    hand.page.state("delete navigator.getGamepads")


def test_gamepad_pulls_while_its_button_is_pressed_and_rumbles(hand: Held) -> None:
    hand.page.tab.keyboard.press("2")  # from the side: x to the right
    hand.page.state(GAMEPAD)
    hand.page.state("pad.axes[0] = 1, pad.buttons[0].pressed = true")
    first = hand.next()
    assert first.target_m[0] > AT[0]
    hand.own_hand(AT, (-1.5, 0.0, 0.0))
    hand.page.until("rumbles.length > 0")
    name, effect = hand.page.state("rumbles[0]")
    assert (name, effect["strongMagnitude"]) == ("dual-rumble", 0.5)
    hand.page.state("pad.buttons[0].pressed = false")
    said = hand.until_released()
    hand.page.state("delete navigator.getGamepads")
    along = [each.target_m[0] for each in said[:-1]]
    assert along == sorted(along)


def test_somebody_joins_and_the_hand_keeps_its_hold(hand: Held) -> None:
    hand.press()
    hand.next()
    hand.server.send(to_json(scene(people=3, hand=True)))
    hand.page.until("cogrip.scene.people.length === 3")
    assert hand.page.state("cogrip.hand.target_m") == pytest.approx(AT, abs=1e-12)
    hand.page.tab.mouse.up()
    assert all(each.holds for each in hand.until_released()[:-1])


def test_new_socket_counts_its_messages_from_one_and_holds_nothing(hand: Held) -> None:
    hand.press()
    assert hand.next().number == 1
    hand.server.come_again()
    hand.page.until("document.getElementById('status').hidden")
    assert hand.page.state("cogrip.hand.target_m") is None
    hand.page.tab.mouse.up()
    hand.own_hand(AT)
    hand.page.until("cogrip.hand.own !== null")
    hand.press()
    assert hand.next().number == 1


def test_page_without_a_hand_says_nothing(show: Show) -> None:
    page, server = show(scene())
    held = Held(page, server)
    x, y = held.press()
    page.tab.mouse.move(x + 50, y)
    page.tab.mouse.up()
    assert page.state("cogrip.hand.sent") == 0
    assert server.said.empty()
