"""Sounds of a study on a page, in a real browser: what goes to the speaker, read where the page's own graph ends."""

from pathlib import Path

import msgspec
import pytest

from cogrip.cli.main import main
from cogrip.cli.study.pages import Pages
from cogrip.experiments.study.audio import Audio
from cogrip.experiments.study.study_file import StudyError
from cogrip.view.io.study_page import StudyPage
from cogrip.view.panel import PanelMessage, Sound

from tests.cli.command import Cogrip
from tests.experiments.studies import PLAIN, parsed
from tests.view.browser_page import BrowserPage, Show
from tests.view.page_server import PageServer
from tests.view.pictured import scene

SOUND = Sound(tone_hz=440.0, tone_s=0.4, tone_level=0.4, noise="white", noise_level=0.3)
NOTE = "[data-part=sound]"
WATCH = "globalThis.most = 0; setInterval(() => { most = Math.max(most, cogrip.sounds.most); }, 5); 0"
WAITED = "new Promise((resolve) => setTimeout(() => resolve(most), 100))"


def tell(server: PageServer, state: str, sound: Sound | None, cue: str = "") -> None:
    message = PanelMessage("P01", state, cue=cue, sound=sound)  # type: ignore[arg-type]
    server.send(msgspec.json.encode(message).decode())


def clicked(page: BrowserPage) -> None:
    """Click, before which a browser lets no page sound."""
    page.until("cogrip.sounds.told !== null")
    page.tab.mouse.click(400, 400)
    page.until("cogrip.sounds.runs")


@pytest.mark.parametrize("noise", ["white", "pink"])
def test_noise_masks_while_a_trial_goes_on_and_only_then(show: Show, noise: str) -> None:
    page, server = show(scene())
    sound = msgspec.structs.replace(SOUND, noise=noise)
    tell(server, "waiting", sound)
    clicked(page)
    page.state(WATCH)
    assert page.state(WAITED) == 0.0, "nothing before the trial"
    tell(server, "running", sound)
    page.until("most > 0.05")
    tell(server, "asking", sound)
    page.until("!cogrip.sounds.noise && cogrip.sounds.most === 0")
    assert page.state("most") <= 0.3 + 1e-3, "as loud as asked for"
    page.state("most = 0")
    assert page.state(WAITED) == 0.0, "silent after the end"


def test_a_tone_sounds_once_a_phase_and_no_level_is_above_half(show: Show) -> None:
    page, server = show(scene())
    loud = msgspec.structs.replace(SOUND, noise="none", tone_level=9.0, tones=3)
    tell(server, "running", loud)
    clicked(page)
    page.state(WATCH)
    assert page.state(WAITED) == 0.0, "that phase had begun before the page came"
    loud = msgspec.structs.replace(loud, tones=4)
    tell(server, "running", loud, "Push")
    page.until("most > 0.4")
    page.until("cogrip.sounds.most === 0")
    assert page.state("most") <= 0.5 + 1e-3
    page.state("most = 0")
    tell(server, "running", loud, "Push on")
    page.until("document.querySelector('[data-part=cue]').textContent === 'Push on'")
    assert page.state(WAITED) == 0.0, "no further phase, no further tone"


def test_a_page_that_is_told_of_no_sound_makes_none(show: Show) -> None:
    page, server = show(scene())
    tell(server, "running", None)
    page.until("!document.getElementById('panel').hidden")
    page.tab.mouse.click(400, 400)
    assert page.state("cogrip.sounds.made") is False
    assert page.text(NOTE) == ""


def test_a_page_that_is_lost_is_silent(show: Show) -> None:
    page, server = show(scene())
    tell(server, "running", SOUND)
    clicked(page)
    page.until("cogrip.sounds.most > 0.05")
    server.come_again()
    page.until("!cogrip.sounds.noise && cogrip.sounds.most === 0")


def test_pages_count_the_phases_that_begin_and_say_nothing_of_sound_where_there_is_none() -> None:
    page = StudyPage("study", {"P01": "token"})
    pages = Pages(page, Audio(tone_hz=440.0, noise="pink"))
    for before in range(2):
        pages.show("P01", "running")
        assert page.panel("P01").message.sound == Sound(tone_hz=440.0, noise="pink", tones=before)
        pages.cue(["P01"], "Push")
        assert page.panel("P01").message.sound == Sound(tone_hz=440.0, noise="pink", tones=before + 1)
    for silent in (Pages(page), Pages(page, Audio(noise_level=0.5))):
        silent.show("P01", "running")
        silent.cue(["P01"], "Push")
        assert page.panel("P01").message.sound is None


@pytest.mark.parametrize(
    ("audio", "words"),
    [({"noise": "brown"}, "audio.noise"), ({"tone_level": 0.6}, "audio.tone_level"),
     ({"noise_level": -0.1}, "audio.noise_level"), ({"tone_hz": 20_000.0}, "audio.tone_hz"), ({"volume": 1.0}, "audio.volume")],
)  # fmt: skip
def test_sounds_that_cannot_be_are_refused(audio: dict[str, object], words: str) -> None:
    with pytest.raises(StudyError, match=words):
        parsed(PLAIN, audio=audio)


def test_sounds_need_pages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "study.toml"
    file.write_text(PLAIN + '[audio]\nnoise = "pink"\n')
    code, _, said = Cogrip(main, capsys)("study", file, "--live", "--out", tmp_path / "out")
    assert code == 2
    assert "[audio] sounds on people's pages; add --view" in " ".join(said.split())
    assert not (tmp_path / "out").exists()
