"""Functions in files of the user's own."""

from __future__ import annotations

import pytest

from dmfc.config.custom_function import custom_function
from dmfc.errors import DmfcError


def test_a_function_is_found_without_running_its_file_and_loaded_as_the_file_is(tmp_path):
    file, ran = tmp_path / "mine.py", tmp_path / "ran"
    text = f"open({str(ran)!r}, 'a').write('x')\n\ndef two():\n    return 2\n"
    file.write_text(text)
    found = custom_function(f"{file}:two", "losses.custom")
    assert not ran.exists()
    assert found.load()() == 2
    assert found.load()() == 2
    assert ran.read_text() == "x"
    file.write_text(text.replace("return 2", "return 3"))
    changed = custom_function(f"{file}:two", "losses.custom")
    assert changed.digest != found.digest
    assert changed.load()() == 3


def test_a_relative_path_starts_where_the_command_is_called(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text("def two():\n    return 2\n")
    monkeypatch.chdir(tmp_path)
    assert custom_function("mine.py:two", "x").file == tmp_path / "mine.py"


@pytest.mark.parametrize(
    ("text", "content", "message"),
    [
        ("mine.py:too", "def two(): ...", "unknown function of mine.py 'too'; did you mean 'two'"),
        ("mine.py:two", "two = 2", "unknown function of mine.py 'two'"),
        ("mine.py:two", "def two(:", "is not Python"),
        ("mine.py", "def two(): ...", "not of the form file.py:function"),
        ("two", "def two(): ...", "not of the form file.py:function"),
        ("other.py:two", "def two(): ...", "cannot read .*other.py"),
        ("mine.py:two", "import nosuch\ndef two(): ...", "cannot be run: ModuleNotFoundError"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, monkeypatch, text, content, message):
    (tmp_path / "mine.py").write_text(content)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DmfcError, match=message) as raised:
        custom_function(text, "losses.custom").load()
    assert "\n" not in str(raised.value)
    assert str(raised.value).startswith("losses.custom: ") or "cannot be run" in str(raised.value)
