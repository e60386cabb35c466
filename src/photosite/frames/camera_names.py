"""Names of cameras, compared without case, punctuation and the maker's company name."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence

from photosite.errors import InputError

_MOST_LISTED = 8

_COMPANY = {
    *("corporation", "corp", "company", "co", "ltd", "inc", "ag", "gmbh", "optical", "imaging", "camera", "cameras"),
    *("electronics", "electric", "techwin", "digital", "solutions", "computer", "eastman"),
}
"""Words that makers add to their name in raw files."""


def name_words(*parts: str) -> tuple[str, ...]:
    """Return the words that a name is compared by: in lower case, without company words and repetitions.

    Examples
    --------
    >>> name_words("NIKON CORPORATION", "NIKON D850"), name_words("Nikon D850"), name_words("Canon EOS-1Ds")
    (('nikon', 'd850'), ('nikon', 'd850'), ('canon', 'eos', '1ds'))
    """
    words: list[str] = []
    for word in re.findall(r"[^\W_]+(?:\+|\*)?", " ".join(parts).lower()):
        if word not in words and not (word in _COMPANY and words):
            words.append(word)
    return tuple(words)


def matching(query: str, names: Sequence[str]) -> tuple[int, ...]:
    """Return the indices of the names that a query stands for.

    These are the names with the same words, joined or not (EOS 1D, EOS-1D, EOS1D). Without one, they are the names that
    contain every word of the query.

    Examples
    --------
    >>> matching("D3", ["Nikon D3", "Nikon D300"]), matching("nikon", ["Nikon D3", "Nikon D300"])
    ((0,), (0, 1))
    """
    asked = name_words(query)
    words = [name_words(name) for name in names]
    same = [k for k, found in enumerate(words) if asked and "".join(found) == "".join(asked)]
    if same:
        return tuple(same)
    # At least one word: an empty query is in every name.
    return tuple(k for k, found in enumerate(words) if asked and set(asked) <= set(found))


def full_name(maker: str, model: str) -> str:
    """Return maker and model, the maker once: its company name is shortened where the model repeats it.

    Examples
    --------
    >>> full_name("Nikon", "D850"), full_name("NIKON CORPORATION", "NIKON D850")
    ('Nikon D850', 'NIKON D850')
    """
    if not maker or not model or name_words(model)[:1] == name_words(maker)[:1]:
        return model or maker
    return f"{maker} {model}"


def one_camera(query: str, names: Sequence[str], argument: str, where: str | None = None) -> tuple[int, ...]:
    """Return the indices of the names of the one camera that a query stands for; several names may be of one camera.

    Raises
    ------
    InputError
        With `argument` as its name, if no camera or several match.

    Examples
    --------
    >>> one_camera("NIKON CORPORATION NIKON D3", ["Nikon D3", "Nikon D300"], "name")
    (0,)
    """
    found = matching(query, names)
    several = list(dict.fromkeys(names[k] for k in found))
    if not found:
        close = nearest(query, names)
        hint = f"Did you mean {' or '.join(map(repr, close))}?" if close else "photosite cameras list shows their names"
        expected = f"one of {len(set(names))} cameras in the files"
        raise InputError(argument, where=where, value=query, expected=expected, hint=hint)
    if len({" ".join(name_words(name)) for name in several}) > 1:
        others = f" and {len(several) - _MOST_LISTED} others" if len(several) > _MOST_LISTED else ""
        hint = f"It matches {', '.join(several[:_MOST_LISTED])}{others}"
        raise InputError(argument, where=where, value=query, expected="the name of one camera", hint=hint)
    return found


def searched(query: str, names: Sequence[str]) -> tuple[int, ...]:
    """Return the indices of the names that contain every word of a query, also as a part of a word.

    Examples
    --------
    >>> searched("nik d3", ["Nikon D3", "Nikon D300", "Canon 5D"])
    (0, 1)
    """
    asked = name_words(query)
    return tuple(k for k, name in enumerate(names) if all(word in " ".join(name_words(name)) for word in asked))


def nearest(query: str, names: Sequence[str], count: int = 3) -> list[str]:
    """Return the most similar names, the most similar first.

    Examples
    --------
    >>> nearest("Nikon D855", ["Nikon D850", "Canon 5D"], 1)
    ['Nikon D850']
    """
    by_words = {" ".join(name_words(name)): name for name in names}
    return [by_words[key] for key in difflib.get_close_matches(" ".join(name_words(query)), by_words, count, 0.5)]
