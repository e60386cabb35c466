"""Tables that undo a tone curve."""

import pickle

import numpy as np
import pytest

from photosite.errors import FileError, InputError
from photosite.frames.frame_set import FrameSet
from photosite.frames.linearization import LinearizationTable, linearize, read_linearization

FRAMES = FrameSet.from_arrays([("dark", 0.1, np.arange(4, dtype=np.uint16).reshape(2, 2))], bits=2)


@pytest.mark.parametrize(
    "text",
    ["0\n1\n4\n9\n", "code,value\n0,0\n1,1\n2,4\n3,9\n", "# table\n0 0\n1 1.0\n\n2 4\n3 9", "0;0\n1;1\n2;4\n3;9\n"],
)
def test_a_table_is_read(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    table = read_linearization(path)
    assert table.numbers.tolist() == [0, 1, 4, 9]
    assert table.scale == 1.0


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("0\n2\n1\n3\n", r"values\[2\]"),
        ("0,0\n2,4\n", "code must be 1, got 2"),
        ("0,0\n1\n", "each line"),
        ("0,0,0\n", "each line"),
        ("0\none\n", "line 2"),
        ("", "each line"),
        ("5\n", "values"),
        ("1\n1\n", "different"),
        ("-1\n1\n", "0 or above"),
        ("0\nnan\n", "finite"),
    ],
)
def test_an_invalid_table_is_refused(tmp_path, text, what):
    path = tmp_path / "table.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match=what):
        read_linearization(path)


def test_frames_are_replaced_and_the_set_pickles():
    linear = pickle.loads(pickle.dumps(linearize(FRAMES, LinearizationTable(np.array([0.0, 10, 100, 1000])))))
    (frame,) = linear.groups[0]
    assert frame.dtype == np.uint16
    assert frame.tolist() == [[0, 10], [100, 1000]]
    assert linear.bits == 10


def test_values_that_are_not_whole_are_scaled_to_16_bits():
    table = LinearizationTable(np.array([0.0, 0.1, 0.5, 2.0]))
    assert table.numbers.tolist() == [0, 3277, 16384, 65535]
    assert table.scale == 65535 / 2.0
    assert "32767.5" in linearize(FRAMES, table).warnings[-1]


def test_a_table_shorter_than_the_codes_is_refused():
    with pytest.raises(InputError) as caught:
        linearize(FRAMES, LinearizationTable(np.array([0.0, 1.0, 2.0])))
    assert caught.value.value == 3
