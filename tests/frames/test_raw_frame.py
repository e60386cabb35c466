"""Values of a raw frame that its constructor checks or completes."""

import numpy as np
import pytest

from photosite import RawFrame, read_raw
from photosite.errors import FileError, InputError

DN = np.zeros((4, 4), np.uint16)


def test_a_mosaic_by_name():
    assert RawFrame(DN, 12, cfa="grbg").cfa == (("G", "R"), ("B", "G"))
    assert RawFrame(DN, 12, cfa="mono").cfa == (("M",),)
    assert RawFrame(DN, 12, cfa=[["B", "G"], ["G", "R"]]).cfa == (("B", "G"), ("G", "R"))
    with pytest.raises(InputError) as caught:
        RawFrame(DN, 12, cfa="xyz")
    assert (caught.value.what, caught.value.value) == ("cfa", "xyz")


def test_a_name_that_the_system_refuses():
    with pytest.raises(FileError):
        read_raw("x" * 5000)
