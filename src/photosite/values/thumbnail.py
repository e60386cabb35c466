"""Small pictures of large arrays, as HTML for notebooks."""

from __future__ import annotations

import base64
import html
import io

import numpy as np
from numpy.typing import NDArray

WIDEST_PX = 480
"""Largest width and height of a thumbnail."""


def stride_for(rows: int, cols: int, widest: int = WIDEST_PX) -> int:
    """Return the step between the samples of a thumbnail.

    Examples
    --------
    >>> stride_for(100, 480), stride_for(10_000, 15_000)
    (1, 32)
    """
    return -(-max(rows, cols) // widest)


def thumbnail_html(picture: NDArray[np.floating], caption: str) -> str:
    """Return a picture in display sRGB, (rows, cols, 3) from 0 to 1, as an HTML image with a caption.

    Small pictures are enlarged, their pixels kept as squares.
    """
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(np.rint(np.clip(picture, 0.0, 1.0) * 255.0).astype(np.uint8)).save(stream, format="PNG")
    uri = base64.b64encode(stream.getvalue()).decode("ascii")
    rows, cols = picture.shape[:2]
    factor = max(1, WIDEST_PX // 2 // max(rows, cols))
    words = html.escape(caption)
    image = (
        f'<img src="data:image/png;base64,{uri}" alt="{words}" width="{cols * factor}" height="{rows * factor}" '
        'style="image-rendering:pixelated">'
    )
    return f"<figure>{image}<figcaption>{words}</figcaption></figure>"
