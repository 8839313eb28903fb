"""The animation: what it refuses, what it holds, and that it moves in a browser."""

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from pendulab import animation

ALT = "Two double pendulums swing side by side, and the second lags a little behind the first."
TIMES = np.linspace(0.0, 10.0, 800)
SWING = np.column_stack([2.0 * np.cos(2.0 * TIMES), 2.5 * np.cos(3.0 * TIMES) + 0.3 * TIMES])


def make(**changes):
    given = {
        "tracks": {"recorded": SWING, "estimated": SWING + 0.2},
        "times": TIMES,
        "lengths": (0.091, 0.070),
        "alt": ALT,
        "reference": SWING,
    }
    return animation.double_pendulum(**(given | changes))


def data(shown) -> dict:
    return json.loads(re.search(r'<script type="application/json">(.*?)</script>', shown.html, re.S)[1])


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"tracks": {}}, "at least one label"),
        ({"tracks": [SWING]}, "at least one label"),
        ({"tracks": {"a": SWING.T}}, r"the track 'a' must have shape \(800, 2\).*not \(2, 800\)"),
        ({"tracks": {"a": np.where(TIMES[:, None] > 5, np.nan, SWING)}}, "'a' .*not finite at instant 400"),
        ({"reference": SWING[:-1]}, r"the reference must have shape \(800, 2\)"),
        ({"times": TIMES[:, None]}, r"times must have shape \(T,\)"),
        ({"times": TIMES[:1]}, "at least two instants"),
        ({"times": TIMES[::-1]}, "increase"),
        ({"times": np.where(TIMES > 5, np.inf, TIMES)}, "finite"),
        ({"lengths": (1.0, -1.0)}, "positive"),
        ({"lengths": (1.0,)}, "the two arm lengths"),
        ({"lengths": (1.0, np.nan)}, "finite"),
        ({"alt": " "}, "in words"),
        ({"trail": 0.0}, "trail must be positive"),
        ({"speed": float("nan")}, "speed must be positive"),
        ({"frames": 1}, "frames must be at least 2"),
        ({"width": -5}, "width must be positive"),
    ],
)
def test_bad_input_is_refused_with_a_sentence(changes, sentence):
    with pytest.raises(ValueError, match=sentence):
        make(**changes)


def test_numbers_in_the_page_are_the_tracks():
    kept = data(make(frames=800))
    np.testing.assert_allclose(np.array(kept["tracks"][1]).T / 1000, SWING + 0.2, atol=0.5001e-3)
    np.testing.assert_allclose(np.array(kept["ghost"]).T / 1000, SWING, atol=0.5001e-3)
    np.testing.assert_allclose(np.array(kept["ms"]) / 1000, TIMES, atol=0.5001e-3)


def test_thinning_keeps_both_ends_and_the_order():
    kept = data(make(frames=50))
    assert len(kept["ms"]) == 50 == len(kept["tracks"][0][0])
    assert (kept["ms"][0], kept["ms"][-1]) == (0, 10_000)
    assert np.all(np.diff(kept["ms"]) > 0)


def test_page_stays_small():
    """Three tracks of six hundred frames, however long the recording."""
    times = np.arange(17_500) / 400
    wild = np.column_stack([40 * np.sin(times), 90 * np.sin(0.7 * times)])
    shown = make(tracks={"a": wild, "b": wild + 1, "c": wild + 2}, times=times, reference=wild)
    assert len(shown.html.encode()) < 60_000


def test_panel_leaves_room_for_what_rises_above_the_pivot():
    still = np.zeros_like(SWING)
    assert data(make(tracks={"still": still}, reference=None))["top"] == 0.0
    assert data(make(tracks={"still": still}, reference=still + np.pi))["top"] == 1.0


def test_asks_nothing_of_the_network():
    assert not re.search(r"(https?:)?//\w", make().html.replace("// ", ""))


def test_labels_cannot_break_the_page():
    shown = make(tracks={'<b>"bold" & </script>': SWING}, alt='a "quoted" <alt>', reference_label="<i>")
    assert "<b>" not in shown.html and "<alt>" not in shown.html and "<i>" not in shown.html

    class Labels(HTMLParser):
        found = None

        def handle_starttag(self, tag, attributes):
            if tag == "canvas":
                self.found = dict(attributes)["aria-label"]

    parser = Labels()
    parser.feed(shown.html)
    assert parser.found == '<b>"bold" & </script>: a "quoted" <alt>'


def test_same_input_gives_the_same_bytes():
    assert make().html == make().html
    assert make().html != make(tracks={"recorded": SWING}).html


@pytest.fixture
def show(browser, listen, tmp_path):
    """Open animations as a file; collect what goes wrong; close when the test is over."""
    contexts = []

    def showing(*animations, width=900, scheme="light", motion="reduce"):
        page = tmp_path / "page.html"
        body = "\n".join(one._repr_html_() for one in animations)
        page.write_text(f'<!doctype html><html lang="en"><meta charset="utf-8"><title>t</title><body>{body}')
        context = browser.new_context(
            viewport={"width": width, "height": 900}, color_scheme=scheme, reduced_motion=motion
        )
        contexts.append(context)
        tab, complaints = listen(context)
        tab.goto(page.as_uri())
        return tab, complaints

    yield showing
    for context in contexts:
        context.close()


def pictures(tab) -> list[str]:
    return tab.evaluate("[...document.querySelectorAll('canvas')].map(canvas => canvas.toDataURL())")


def move_to(tab, frame, which=0):
    tab.evaluate(
        """([which, frame]) => {
          const slider = document.querySelectorAll("input")[which];
          slider.value = frame;
          slider.dispatchEvent(new Event("input"));
        }""",
        [which, frame],
    )


def test_slider_moves_every_panel_and_reset_brings_them_back(show):
    tab, complaints = show(make())
    start = pictures(tab)
    move_to(tab, 300)
    later = pictures(tab)
    assert all(one != other for one, other in zip(start, later, strict=True))
    assert (
        tab.locator("output").text_content()
        == tab.locator("input").get_attribute("aria-valuetext")
        != "0.00 s"
    )
    tab.get_by_role("button", name="Reset").click()
    assert pictures(tab) == start
    assert not complaints


def test_what_is_drawn_is_where_the_pendulum_is(show):
    """At rest it hangs straight down from the pivot; lifted by 90 degrees it points to the right."""
    still = np.zeros((2, 2))
    tab, _ = show(make(tracks={"a": still}, times=[0, 1], lengths=(1, 1), reference=None))
    tab2, _ = show(make(tracks={"a": still + np.pi / 2}, times=[0, 1], lengths=(1, 1), reference=None))
    centre = """() => {
      const { width, height } = document.querySelector("canvas");
      const pen = document.querySelector("canvas").getContext("2d");
      const opacity = pen.getImageData(0, 0, width, height).data.filter((_, i) => i % 4 === 3);
      const drawn = [...opacity.keys()].filter(i => opacity[i] > 200);
      const mean = values => values.reduce((sum, value) => sum + value, 0) / values.length / width;
      return [mean(drawn.map(i => i % width)), mean(drawn.map(i => Math.floor(i / width)))];
    }"""
    (x, y), (x2, y2) = tab.evaluate(centre), tab2.evaluate(centre)
    reach = 1 / (2 + 2 * 0.08)  # of the panel's width
    assert x == pytest.approx(0.5, abs=0.01)
    assert y == pytest.approx((0.08 + 0.5) * reach, abs=0.04)
    assert x2 == pytest.approx(0.5 + 0.5 * reach, abs=0.04)
    assert y2 == pytest.approx(0.08 * reach, abs=0.02)


def test_play_runs_to_the_end_and_pause_holds(show):
    tab, complaints = show(make(speed=1e-6))
    button = tab.get_by_role("button", name="Play")
    button.click()
    assert tab.locator(".play").text_content() == "Pause"
    tab.get_by_role("button", name="Pause").click()
    assert tab.locator(".play").text_content() == "Play"

    tab, complaints = show(make(speed=1e6))  # the whole film within one frame of the screen
    start = pictures(tab)
    tab.get_by_role("button", name="Play").click()
    tab.wait_for_function("document.querySelector('input').value === document.querySelector('input').max")
    assert pictures(tab) != start
    assert tab.locator(".play").text_content() == "Play"
    assert not complaints


def test_keyboard_alone_is_enough(show):
    tab, _ = show(make(speed=1e-6))
    tab.keyboard.press("Tab")
    tab.keyboard.press("Enter")
    assert tab.locator(".play").text_content() == "Pause"
    tab.keyboard.press("Tab")
    tab.keyboard.press("Tab")
    before = pictures(tab)
    for _ in range(5):
        tab.keyboard.press("ArrowRight")
    assert tab.locator("input").input_value() == "5"
    assert tab.locator(".play").text_content() == "Play"
    assert pictures(tab) != before


def test_starts_by_itself_only_when_motion_is_welcome(show):
    tab, _ = show(make(speed=1e-6), motion="no-preference")
    tab.wait_for_function("document.querySelector('.play').textContent === 'Pause'")
    tab, _ = show(make(speed=1e-6), motion="reduce")
    tab.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert tab.locator(".play").text_content() == "Play"


def test_several_on_a_page_do_not_disturb_each_other(show):
    """Also when two are the same to the last byte."""
    tab, complaints = show(make(), make(), make(tracks={"alone": SWING}))
    start = pictures(tab)
    assert len(start) == 5
    tab.evaluate(
        "(pen => { const clear = pen.clearRect; window.drawn = 0;"
        " pen.clearRect = function (...all) { window.drawn++; return clear.apply(this, all); } })"
        "(CanvasRenderingContext2D.prototype)"
    )
    move_to(tab, 200, which=0)
    assert tab.evaluate("window.drawn") == 2  # the two panels of the first, each once
    changed = [one != other for one, other in zip(start, pictures(tab), strict=True)]
    assert changed == [True, True, False, False, False]
    assert not complaints


def test_panels_stack_on_a_phone(show):
    tops = "[...document.querySelectorAll('canvas')].map(canvas => canvas.getBoundingClientRect().top)"
    wide, _ = show(make())
    assert len(set(wide.evaluate(tops))) == 1
    narrow, _ = show(make(), width=390)
    assert len(set(narrow.evaluate(tops))) == 2
    assert narrow.evaluate("document.documentElement.scrollWidth") <= 390
