"""Every page of the built book, opened from disk as a reader opens it, at both widths and in both schemes."""

import re
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pages
import pytest

LOOK = (Path(__file__).parent / "look.js").read_text(encoding="utf-8")
DESK, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}
WORDS = ".bd-article :is(p, li, td, th, dt, dd, h1, h2, h3, span, a, code, button, figcaption, summary)"


@pytest.mark.parametrize("first", ["desk", "phone"])
@pytest.mark.parametrize("name", pages.names())
def test_page_reads_well(site, browser, listen, name, first):
    """Loaded once at each width, so that what runs at loading is seen at both, then shown in both schemes."""
    size, scheme = (DESK, "light") if first == "desk" else (PHONE, "dark")
    context = browser.new_context(viewport=size, color_scheme=scheme, reduced_motion="reduce")
    tab, complaints = listen(context)
    tab.goto((site / f"{name}.html").as_uri(), wait_until="load")
    seen = [f"{first}, {scheme}: {one}" for one in tab.evaluate(LOOK, {"scheme": scheme, "painted": WORDS})]
    other = "dark" if scheme == "light" else "light"
    tab.emulate_media(color_scheme=other, reduced_motion="reduce")
    seen += [f"{first}, {other}: {one}" for one in tab.evaluate(LOOK, {"scheme": other, "painted": WORDS})]
    context.close()
    assert not complaints + seen, "\n".join([f"{name}.html:", *complaints, *seen])


def test_search_works_from_disk(site, browser, listen):
    context = browser.new_context(viewport=DESK)
    tab, complaints = listen(context)
    tab.goto((site / "search.html").as_uri() + "?q=pendulum")
    tab.wait_for_selector("#search-results li a", timeout=5000)
    context.close()
    assert not complaints


def test_links_lead_somewhere(site):
    """Every link inside the site ends at a page, and at a place on it."""
    found = {path: pages.Links(path.read_text(encoding="utf-8")) for path in _built(site)}
    dead = []
    for page, one in found.items():
        for link in one.links:
            target, anchor = urldefrag(unquote(link))
            if re.match(r"[a-z]+:", target):
                continue
            goal = (page.parent / target).resolve() if target else page
            if not goal.exists():
                dead.append(f"{page.relative_to(site)}: {link} leads to no file")
            elif anchor and goal in found and anchor not in found[goal].anchors:
                dead.append(f"{page.relative_to(site)}: {link} leads to no place on that page")
    assert not dead, "\n".join(dead)


def test_pages_load_only_what_the_site_carries(site):
    """Also what a browser would load later or only under some condition."""
    for page in _built(site):
        for load in pages.Links(page.read_text(encoding="utf-8")).loads:
            assert not re.match(r"([a-z]+:)?//", load), f"{page.relative_to(site)} loads {load}"


def test_site_tells_no_answers(site):
    """The sources of pages hold the folded answers; the site does not hand them out."""
    assert not (site / "_sources").exists()


def _built(site):
    return [path for path in sorted(site.rglob("*.html")) if "_static" not in path.relative_to(site).parts]
