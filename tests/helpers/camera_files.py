"""Small files of cameras, as darktable and rawtoaces write them; the numbers are invented."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

WAVELENGTHS = range(380, 781, 5)


def darktable_content() -> dict[str, Any]:
    """Four cameras of two makers; a and b are proportional to the ISO."""

    def model(name: str, *isos: int, comment: str = "") -> dict[str, Any]:
        profiles = [
            {"name": f"{name} iso {iso}", "iso": iso, "a": [4e-8 * iso, 2e-8 * iso, 3e-8 * iso], "b": [1e-10 * iso] * 3}
            for iso in isos
        ]
        return {"comment": comment, "model": name, "profiles": profiles}

    nikon = [model("D850", 64, 400, 6400, comment="d850 contributed by a user"), model("D3", 200), model("D300", 200)]
    makers = [{"maker": "Nikon", "models": nikon}, {"maker": "Canon", "models": [model("EOS-1Ds", 100, 200)]}]
    return {"version": 0, "noiseprofiles": makers}


def rawtoaces_content() -> dict[str, Any]:
    """A Nikon D850 with triangles around 600, 540 and 460 nm."""

    def triangle(peak: int, wavelength: int) -> float:
        return max(0.0, 1.0 - abs(wavelength - peak) / 100.0)

    rows = {str(nm): [triangle(peak, nm) for peak in (600, 540, 460)] for nm in WAVELENGTHS}
    header = {
        "schema_version": "0.1.0",
        "manufacturer": "Nikon",
        "model": "D850",
        "description": "made up",
        "document_creator": "a lab",
        "document_creation_date": "2017-04-11T12:00:00Z",
        "license": "Apache-2.0",
    }
    spectral = {"units": "relative", "index": {"main": ["R", "G", "B"]}, "data": {"main": rows}}
    return {"header": header, "spectral_data": spectral}


def write_json(path: Path, content: dict[str, Any]) -> Path:
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


if __name__ == "__main__":
    write_json(Path(sys.argv[1]), darktable_content())
