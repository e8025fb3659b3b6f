"""The page in a browser without network."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support import recorded_journal as recorded
from tests.support.browser import FOUND, MISSING, OPTIONS, Browser

SIZE = 700, 440
HIGH, LEFT = 300, 285
"""Position of the canvas, above the slider and right of the legend, in pixels."""
TOLERANCE = 0.12
"""Tolerance for the hue of a colour in light and shade, as a unit vector."""
BLUE, VERMILLION, CREAM, BROWN = "#0072B2", "#D55E00", "#FFF3D6", "#8A3B00"

pytestmark = pytest.mark.skipif(FOUND is None, reason=MISSING)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    opened = Browser(tmp_path_factory.mktemp("browser"), SIZE)
    yield opened
    opened.close()


def share_of(picture: np.ndarray, colour: str) -> float:
    """Fraction of the canvas that has a colour, in light or shade."""
    canvas = picture[:HIGH, LEFT:].reshape(-1, 3)
    seen = canvas[(canvas.max(axis=1) > 25.0) & (np.ptp(canvas, axis=1) > 8.0)]
    wanted = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)], dtype=float)
    hues = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    near = np.linalg.norm(hues - wanted / np.linalg.norm(wanted), axis=1) < TOLERANCE
    return float(near.sum()) / len(canvas)


def at_frame(browser: Browser, frame: int) -> np.ndarray:
    """The canvas after the slider has moved to a frame."""
    move = f"const s = document.getElementById('time'); s.value = {frame}; s.oninput();"
    browser.ask("{" + move + "}")
    browser.wait(f"document.body.dataset.frame == {frame}")
    return browser.picture()


def test_a_mechanism_moves_with_the_slider_and_plays(browser, tmp_path):
    scene, motion = recorded.arm_in_bearing(), recorded.motion()
    view = cj.view(scene, motion, observation=recorded.observed(), bearing_scale=4.0)
    page = view.save(tmp_path / "arm.html").as_uri()
    browser.open(page + "#t=0.005")
    assert browser.ask("document.getElementById('clock').textContent") == "t = 4.62 ms"
    flying, touching = at_frame(browser, 5), at_frame(browser, 30)
    for picture in (flying, touching):
        assert share_of(picture, BLUE) > 1e-3
    assert share_of(flying, CREAM) > 1e-3
    assert share_of(flying, VERMILLION) < 1e-4
    assert share_of(touching, VERMILLION) + share_of(touching, BROWN) > 1e-3
    browser.ask("document.getElementById('play').click()")
    browser.wait("+document.body.dataset.frame != 30")
    assert browser.ask("document.getElementById('play').textContent") == "Pause"
    assert browser.errors == []


@pytest.mark.slow
def test_a_page_without_webgl_shows_a_message(tmp_path):
    view = cj.view(recorded.arm_in_bearing(), recorded.motion(), forces=False, frames=2)
    page = view.save(tmp_path / "arm.html").as_uri()
    flat = tuple(option for option in OPTIONS if "gl" not in option)
    browser = Browser(tmp_path / "profile", SIZE, (*flat, "--disable-gpu", "--disable-3d-apis"))
    try:
        browser.open(page, "document.body && document.body.dataset.failed")
        said = browser.ask("document.getElementById('no-webgl').textContent")
        assert "this browser has no WebGL" in said and "view.png" in said
    finally:
        browser.close()


@pytest.mark.slow
def test_a_notebook_shows_it_in_a_frame(browser, tmp_path):
    view = cj.view(recorded.arm_in_bearing(), recorded.motion(), forces=False)
    script = "<script>setInterval(() => { const inside = document.querySelector('iframe')"
    script += ".contentDocument; if (inside && inside.body && inside.body.dataset.ready) "
    script += "document.body.dataset.ready = 'yes'; }, 50)</script>"
    page = tmp_path / "notebook.html"
    page.write_text(f"<!doctype html><body>{view._repr_html_()}{script}", encoding="utf-8")
    browser.open(page.as_uri())
    browser.wait("document.querySelector('iframe').contentDocument.body.dataset.frame == '0'")
    assert share_of(browser.picture(), BLUE) > 1e-3
    assert browser.errors == []
