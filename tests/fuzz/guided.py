"""Fuzz one reader guided by coverage, with atheris: `python tests/fuzz/guided.py READER [libFuzzer's options]`.

Needs `pip install '.[fuzz]'`; `-max_total_time=60` limits the time. Python code is instrumented, C libraries
are not. Findings are written to the working directory.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory


def main() -> None:
    """Run the command."""
    import atheris

    sys.path.insert(0, str(Path(__file__).parent))
    import photosite.engine.mosaic
    import photosite.engine.pixel_model
    import photosite.engine.truncated_normal

    with atheris.instrument_imports(include=["photosite", "ruamel", "tifffile"], exclude=["photosite.engine"]):
        import fuzzing

        import photosite.calibration.spectral.protocol
        import photosite.frames.open
        import photosite.studies.chart_spectral  # noqa: F401

    with TemporaryDirectory() as place:
        folder = Path(place)
        targets = fuzzing.targets(folder)
        if len(sys.argv) < 2 or sys.argv[1] not in targets:
            sys.exit(f"usage: guided.py READER [options]; readers are: {', '.join(targets)}")
        target = targets[sys.argv.pop(1)]
        corpus = folder / "corpus"
        corpus.mkdir()
        for number, seed in enumerate(target.seeds):
            (corpus / f"{number}").write_bytes(seed)
        path = folder / f"input{target.suffix}"

        def one(data: bytes) -> None:
            path.write_bytes(data)
            fuzzing.outcome(target, path)

        atheris.Setup([*sys.argv, str(corpus), "-timeout=10", "-rss_limit_mb=4096", "-max_len=8192"], one)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
