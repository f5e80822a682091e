"""Elements and the bytes that they stand on."""

import pytest
from oarlock.base.errors import InputError
from oarlock.diagnosis.edit.markup import escaped, parse

TEXT = (
    b"\xef\xbb\xbf<?xml version='1.0'?>\r\n<!DOCTYPE mujoco>\r\n<!-- -- <equality> -- -->\r\n"
    b"< mujoco model = 'a&amp;b'>\r\n\t<![CDATA[<equality/>]]>\r\n"
    b"\t<option\ttimestep=\"1e-3\"\r\n\t\tgravity='0 0 &#45;1'/>"
    b'\r\n\t<body name="\xc3\xa4 > &lt;\'&quot;"></body  ></mujoco  >\r\n<a/>'
)


def test_every_element_stands_on_its_bytes():
    root = parse(TEXT, "a.xml")
    option, body = root.children
    assert (root.tag, root.get("model"), option.tag, body.tag) == ("mujoco", "a&b", "option", "body")
    assert TEXT[root.start : root.end].startswith(b"< mujoco model")
    assert TEXT[root.start : root.end].endswith(b"</mujoco  >")
    assert TEXT[option.start : option.end].endswith(b"&#45;1'/>")
    assert TEXT[body.opened : body.end] == b"</body  >"
    assert (option.closing, TEXT[body.closing : body.end]) == (None, b"</body  >")
    assert body.get("name") == "ä > <'\""
    gravity = option.attributes["gravity"]
    assert (gravity.text, gravity.quote, TEXT[gravity.start : gravity.end]) == ("0 0 -1", "'", b"0 0 &#45;1")
    assert [one.tag for one in root.within()] == ["mujoco", "option", "body"]


@pytest.mark.parametrize("text", ["ä<&\"'>\n\r", "\udce4", "&#10;"])
@pytest.mark.parametrize("quote", ["'", '"'])
def test_what_is_escaped_is_read_as_it_was(text, quote):
    mark = quote.encode()
    assert parse(b"<a b=" + mark + escaped(text, quote) + mark + b"/>", "a.xml").get("b") == text


@pytest.mark.parametrize("text", [b"", b"<a>", b"<a></b>", b"<a b></a>", b"<a b=1/>", b"<!-- <a/>", b"<a b='1/>"])
def test_what_is_not_well_formed_is_named(text):
    with pytest.raises(InputError, match=r"a\.xml: not well-formed"):
        parse(text, "a.xml")
