"""The text of an error on one line, whatever was raised."""

from __future__ import annotations

import pytest

from dmfc.errors import first_line, one_line


@pytest.mark.parametrize(
    ("error", "first", "one"),
    [
        (ValueError("a\n  b\tc"), "a", "a b c"),
        (ValueError("\n\n a \nb"), "a ", "a b"),
        (EOFError(), "EOFError", "EOFError"),
        (OSError(" \n"), "OSError", "OSError"),
    ],
)
def test_the_text_of_an_error(error, first, one):
    assert first_line(error) == first
    assert one_line(error) == one


def test_a_long_text_is_cut():
    assert one_line(ValueError("word\n" * 100), most=9) == "word word"
