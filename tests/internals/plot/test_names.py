"""Names with any characters in one line."""

from clearjoint._fields.drawn_text import LONGEST_NAME, shown


def test_a_name_is_shown_literally_and_in_one_line():
    assert shown("$x$") == r"\$x\$"
    assert shown("a\nb") == "a b"
    assert shown("_a").lstrip("\u200b") == "_a" and not shown("_a").startswith("_")
    assert len(shown("n" * 200 + "1")) == LONGEST_NAME and shown("n" * 200 + "1").endswith("1")
    assert shown(" ") == "(no name)"
