"""YAML with line numbers, limits, and invalid files."""

from __future__ import annotations

import time

import pytest
from raising import raises

from photosite.errors import FileError
from photosite.files.yaml import LARGEST_BYTES, check_keys, line_of, optional_text, parse_yaml, read_yaml


def test_lines_are_counted_from_one():
    data = parse_yaml("a: 1\nb:\n  - x\n  - {c: 2}\n", "f.yaml")
    assert (line_of(data, "a"), line_of(data, "b"), line_of(data["b"], 1), line_of(data, "z")) == (1, 2, 4, None)
    assert line_of(3, "a") is None


def test_aliases_that_expand_too_far_are_an_error_at_once():
    lines = ["a0: &a0 [1, 2, 3, 4, 5, 6, 7, 8, 9]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12)]
    begun = time.monotonic()
    with raises(FileError, "has more than"):
        parse_yaml("\n".join(lines), "bomb.yaml")
    assert time.monotonic() - begun < 2.0


def test_aliases_are_read():
    data = parse_yaml("base: &b {x: 1}\nother: {<<: *b, y: 2}\nlist: [*b, *b]\n", "f.yaml")
    assert dict(data["other"]) == {"x": 1, "y": 2}


@pytest.mark.parametrize("content", ["&a [*a]", "[" * 5000, "{a: " * 3000 + "1" + "}" * 3000, "- " * 5000])
def test_content_that_contains_itself_or_nests_too_deeply_is_an_error(content):
    with pytest.raises(FileError):
        parse_yaml(content, "deep.yaml")


def test_files_that_cannot_be_read(tmp_path):
    with raises(FileError, "there is no such"):
        read_yaml(tmp_path / "none.yaml", "a protocol")
    with raises(FileError, "cannot be read"):
        read_yaml(tmp_path, "a protocol")
    (tmp_path / "a.yaml").write_bytes(b"a: \xff\xfe")
    with raises(FileError, "is not a protocol"):
        read_yaml(tmp_path / "a.yaml", "a protocol")
    (tmp_path / "b.yaml").write_bytes(b"#" * (LARGEST_BYTES + 1))
    with raises(FileError, "is not a protocol"):
        read_yaml(tmp_path / "b.yaml", "a protocol")


def test_keys_and_texts():
    data = parse_yaml("name: x\nfrmes: 3\n", "f.yaml")
    with pytest.raises(FileError) as caught:
        check_keys("f.yaml", data, ("name", "frames"), "a protocol")
    assert (caught.value.line, caught.value.what) == (2, "a protocol has no key 'frmes'")
    assert "'frames'" in str(caught.value.hint)
    assert (optional_text("f.yaml", data, "name"), optional_text("f.yaml", data, "none")) == ("x", None)
    with pytest.raises(FileError) as caught:
        optional_text("f.yaml", data, "frmes")
    assert (caught.value.what, caught.value.value, caught.value.line) == ("frmes", 3, 2)


def test_integers_beyond_floats_are_an_error():
    """The largest float has 1024 bits."""
    assert parse_yaml(f"a: {2**1023}", "f.yaml")["a"] == 2**1023
    with raises(FileError, "has an integer of"):
        parse_yaml("a: [{b: 1" + "0" * 400 + "}]", "f.yaml")


@pytest.mark.parametrize("content", ["a: !!set x", "a: !!int x", "a: !!timestamp x", "a: !!omap 3"])
def test_invalid_tags_are_an_error(content):
    with raises(FileError, "is not", path="f.yaml"):
        parse_yaml(content, "f.yaml")
