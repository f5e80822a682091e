"""Text from models stays text, whatever shows it."""

import json
import tomllib
import unicodedata

import pytest
from markdown_it import MarkdownIt
from oarlock.base.text import (
    LONGEST,
    LONGEST_NAME,
    json_visible,
    markdown,
    markdown_code,
    one_line,
    short_name,
    toml_string,
    visible,
)

EVERY = "".join(map(chr, range(0x110000)))
"""Every character that there is, and the halves of characters that there are not."""

HOSTILE = [
    "\x1b[2K\x1b[1Aoarlock: ALL GATES HOLD",
    "a\nb\r\nc\x00\x07\x9b31m",
    "\u202egnp.exe\u2066\u200b\ufeff",
    "![x](https://evil.example/a.png)",
    "[x](javascript:alert(1))",
    "<img src=x onerror=alert(1)>",
    "<https://evil.example>",
    "`` ` ``|| a | b",
    "# head\n- list\n***",
    "_a_ __b__ *c* ~~d~~ &lt;script&gt; $x$ ^y^",
    '"\n[drive]\nx = "1"',
    "\\",
    "\ud800",
]


def test_visible_leaves_only_what_prints():
    text = visible(EVERY, len(EVERY))
    assert text.isprintable()
    assert not {unicodedata.category(character) for character in text} & {"Cc", "Cf", "Cs", "Zl", "Zp"}
    assert visible("ä – λ̇ ‖ 6 000") == "ä – λ̇ ‖ 6 000"


def test_what_is_too_long_is_cut_and_says_so():
    assert visible("x" * 10**6) == "x" * LONGEST + "… (1000000 characters)"
    one, other = short_name("x" * 10**6), short_name("x" * 10**6 + "y")
    assert one != other
    assert len(one) == len(other) == LONGEST_NAME
    assert short_name("x" * LONGEST_NAME) == "x" * LONGEST_NAME


@pytest.mark.parametrize("text", HOSTILE, ids=ascii)
def test_markdown_shows_the_text_and_nothing_else(text):
    parser = MarkdownIt("gfm-like", {"html": True, "linkify": False})
    for written in (f"word {markdown(text)} word", f"| a |\n| --- |\n| {markdown(text)} |"):
        tokens = [child for token in parser.parse(written) for child in token.children or ()]
        assert {token.type for token in tokens} <= {"text", "text_special"}
        assert one_line(text) in "".join(token.content for token in tokens)


@pytest.mark.parametrize("text", HOSTILE, ids=ascii)
def test_markdown_code_is_one_span(text):
    (inline,) = [token for token in MarkdownIt("commonmark").parse(markdown_code(text)) if token.children]
    assert [child.type for child in inline.children or ()] == ["code_inline"]


@pytest.mark.parametrize(
    "text", [*HOSTILE[:-1], EVERY.encode(errors="ignore").decode()], ids=lambda text: ascii(text)[:40]
)
def test_toml_gives_the_text_back(text):
    written = toml_string(text)
    assert written.isprintable()
    assert tomllib.loads(f"{written} = {written}") == {text: text}


@pytest.mark.parametrize("text", [*HOSTILE, EVERY], ids=lambda text: ascii(text)[:40])
def test_json_gives_the_text_back(text):
    written = json_visible(json.dumps([text], indent=1, ensure_ascii=False))
    assert written.replace("\n", "").isprintable()
    assert json.loads(written) == json.loads(json.dumps([text]))
