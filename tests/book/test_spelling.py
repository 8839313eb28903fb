"""Words of the book: in a dictionary, or in the list of the trade's own words."""

import re

import pages
import pendulab_rules as rules
import pytest
from spellchecker import SpellChecker

WORD = re.compile(r"[^\W\d_²³](?:[^\W\d_²³]|['’](?=[^\W\d_]))+")
OWN = {
    line.strip().lower()
    for line in (pages.ROOT / "tests" / "book" / "words.txt").read_text(encoding="utf-8").splitlines()
    if line.strip() and not line.startswith("#")
}


def unknown(text: str, dictionary: SpellChecker) -> list[str]:
    """Words that no list has; the possessive of a known word is known."""
    words = {re.sub(r"(['’]s|s['’])$", "", word.lower()) for word in WORD.findall(text)}
    return sorted(word for word in dictionary.unknown(words - OWN) if len(word) > 2 and word not in OWN)


@pytest.fixture(scope="module")
def dictionary():
    return SpellChecker(language="en", distance=1)


@pytest.mark.parametrize("page", pages.markdown(), ids=lambda page: page.stem)
def test_page_is_spelled_right(page, dictionary):
    text = page.read_text(encoding="utf-8")
    wrong = unknown(rules.prose(text) + " " + pages.said_in_figures(text), dictionary)
    assert not wrong, f"{page.name}: {', '.join(wrong)}; mend them, or add them to tests/book/words.txt"


def test_wrong_word_is_found_and_own_word_is_not(dictionary):
    assert unknown("The pendulum swigns; Kalman's covariance, Euler's step.", dictionary) == ["swigns"]
    header = "```{code-cell} ipython3\n---\nmystnb:\n  figure:\n    caption: A penduulm.\n---\nx = 1\n```\n"
    assert unknown(pages.said_in_figures(header), dictionary) == ["penduulm"]


def test_list_of_own_words_holds_no_more_than_it_needs(dictionary):
    """In order, each once, and none that the dictionary has."""
    lines = (pages.ROOT / "tests" / "book" / "words.txt").read_text(encoding="utf-8").splitlines()
    words = [line for line in lines if line and not line.startswith("#")]
    assert words == sorted(set(words), key=str.lower)
    assert dictionary.unknown({word.lower() for word in words}) == {word.lower() for word in words}
