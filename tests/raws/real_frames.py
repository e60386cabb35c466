"""Calibrate public sets of real frames, beside what their owners published: `make real-frames DATA=folder`.

The folder holds the sets under the names in `SETS`, as their sources have them; sets that are missing keep their name
in the page. Data are not part of the repository. The page is docs/validation/real-frames.md.
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import photosite as ps
from photosite.errors import PhotositeError

PAGE = Path(__file__).parents[2] / "docs" / "validation" / "real-frames.md"


@dataclass(frozen=True)
class Figure:
    """A row: a figure of the owner beside photosite's estimate, both in the owner's unit, and why they differ."""

    name: str
    owner: str
    estimate: Any
    remark: str = ""
    factor: float = 1.0
    inverse: bool = False

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the row."""
        value = self.estimate.value
        if value is None:
            return self.name, self.owner, f"not estimated: {self.estimate.reason}", "", self.remark
        low, high = (self._unit(bound) for bound in self.estimate.interval_95)
        u = self._unit(value) * self.estimate.standard_uncertainty / abs(value)
        held = "-"
        with contextlib.suppress(ValueError):
            held = "yes" if min(low, high) <= float(self.owner.split()[0]) <= max(low, high) else "no"
        return self.name, self.owner, f"{self._unit(value):.5g} ± {abs(u):.2g}", held, self.remark

    def _unit(self, value: float) -> float:
        return self.factor / value if self.inverse else self.factor * value


@dataclass(frozen=True)
class PublicSet:
    """A set: its folder below the data, its source, what it holds, its rows, and what the rows show."""

    folder: str
    title: str
    source: str
    holds: str
    rows: Callable[[Path], Iterator[Figure | str]]
    shows: str = ""


@contextlib.contextmanager
def protocol(folder: Path, *entries: str) -> Iterator[Path]:
    """Write a protocol with entries whose {data} is the folder."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "protocol.yaml"
        lines = [f"- {{{entry.format(data=folder)}}}" for entry in entries]
        path.write_text("\n".join(["photosite_protocol: 1", "frames:", *lines]) + "\n")
        yield path


class _Reference:
    """A figure of the `emva1288` block, as an estimate."""

    def __init__(self, entry: Any) -> None:
        self.value, self.standard_uncertainty = entry.value, entry.standard_uncertainty
        self.interval_95, self.reason = entry.interval_95, entry.reason


def _emva(result: Any, known: dict[str, str], remarks: dict[str, str]) -> Iterator[Figure]:
    for name, owner in known.items():
        yield Figure(name, owner, result.emva1288[name], remarks.get(name, ""))


def ccd_of_emva(folder: Path) -> Iterator[Figure | str]:
    """Figures of the first reference set; docs/validation/emva-reference.md has them all."""
    result = ps.calibrate(ps.open_frames(folder / "EMVA1288_Data.txt"))
    known = {"K": "0.28006", "eta": "45.249", "sigma_d": "10.924", "DSNU1288": "0.553", "mu_I_mean": "28.479"}
    yield from _emva(result, known, {"DSNU1288": "shifts of the black level from frame to frame are left out"})


def cmos_of_emva(folder: Path) -> Iterator[Figure | str]:
    """Figures of the second reference set."""
    result = ps.calibrate(ps.open_frames(folder / "EMVA1288_Data.txt"))
    known = {"K": "0.020555", "eta": "54.976", "sigma_d": "19.256", "DSNU1288": "6.438", "PRNU1288_unfiltered": "1.418"}
    remarks = {
        "sigma_d": "the reference states the standard's limit of 0.24 DN²",
        "DSNU1288": "rounding hides it",
    }
    yield from _emva(result, known, remarks)
    flats = "the covariances of neighboring pixels are added, 4.8 %, and the signals bend against the light"
    yield Figure("K at small signal, DN/e⁻", known["K"], result.system_gain_dn_per_e, flats)
    named = ("wrong-light-levels", "implausible")
    yield from (
        f"{entry.id}. {_sentence(str(entry))}"
        for entry in result.diagnostics
        if entry.id in named and entry.severity == "warning"
    )


def simulation_of_emva(folder: Path) -> Iterator[Figure | str]:
    """Figures of the third reference set, whose truth is stated in its list."""
    result = ps.calibrate(ps.open_frames(folder / "EMVA1288_Data.txt"))
    light = "0.4950: the stated 0.5 of the photons in the middle, which are stated; the mean is 0.9901 of it"
    dsnu = "two waves of amplitude 1.5 DN, 1.5 DN of noise, and 100 outliers of 0 to 15 DN, added in squares"
    yield Figure("K at small signal, DN/e⁻", "0.1", result.system_gain_dn_per_e)
    yield Figure("read noise, e⁻", "30", result.read_noise_e)
    yield Figure("black level, DN", "29.4", result.black_level_dn)
    yield Figure("DSNU, DN", "2.127", result.dsnu_dn, dsnu)
    yield Figure("PRNU without the fall of the light, %", "0.5", result.prnu1288_percent)
    yield Figure("quantum efficiency", "0.4950", result.quantum_efficiency_percent, light, factor=0.01)
    reference = {"K": "0.097859", "eta": "50.369", "sigma_d": "30.647", "LE_min": "-0.9657", "LE_max": "0.3817"}
    left_out = "one level is left out (below)"
    remarks = dict.fromkeys(("K", "eta", "LE_min", "LE_max"), left_out)
    for figure in _emva(result, reference, remarks):
        yield Figure(f"{figure.name} of the reference implementation", figure.owner, figure.estimate, figure.remark)


TAPS = {
    "1/E": ("8:520,50:1074", "2.49"),
    "4/F": ("8:520,1078:2102", "2.48"),
    "2/H": ("520:1032,50:1074", "2.45"),
    "3/G": ("520:1032,1078:2102", "2.45"),
}
"""Lines of the four amplifiers with light, without blank, overscan and masked ones; published gains, e⁻/DN."""


def sounding_rocket(folder: Path) -> Iterator[Figure | str]:
    """Gain of each amplifier of a CCD230-42 from two flat fields and two dark frames."""
    entries = (
        "kind: dark, exposure: 1.999, files: {data}/led/ESIS1_0486*",
        "kind: light, exposure: 1.999, files: {data}/led/ESIS1_0480*",
    )
    with protocol(folder, *entries) as path:
        for name, (region, owner) in TAPS.items():
            result = ps.calibrate(ps.open_frames(path, region=region))
            yield Figure(f"K of tap {name}, e⁻/DN", owner, result.system_gain_dn_per_e, inverse=True)
            yield Figure(f"read noise of tap {name}, e⁻", "mean of 16 taps: 10.5", result.read_noise_e)


def students_ccd(folder: Path) -> Iterator[Figure | str]:
    """Gain and read noise of an SBIG ST-7 from five bias frames and three flat fields."""
    entries = (
        "kind: dark, exposure: 0, files: {data}/Langford_Zach_CCD/FITS/*BIAS.FIT",
        "kind: light, exposure: 6, files: {data}/Langford_Zach_CCD/FITS/slitview*FLAT.FIT",
    )
    with protocol(folder, *entries) as path:
        result = ps.calibrate(ps.open_frames(path))
    raw = "by the variance of pixels, without the correlation along the rows, which is -1.5 % to the next pixel"
    yield Figure("K, e⁻/DN", "0.4493 (the class)", result.system_gain_dn_per_e, raw, inverse=True)
    yield Figure("K, e⁻/DN", "0.46 (E-GAIN of the camera)", result.system_gain_dn_per_e, inverse=True)
    yield Figure("read noise, e⁻", "16.57 (the class)", result.read_noise_e, "follows from K")
    yield Figure("read noise, DN", "36.87 (the class)", result.read_noise_dn, "with its rounding, 0.002 DN")


def students_whole_folder(folder: Path) -> Iterator[Figure | str]:
    """The whole folders of two students, as they are."""
    for student in ("Langford_Zach_CCD/FITS", "Bergeson,Andi_CCD/data"):
        try:
            result = ps.calibrate(ps.open_frames(folder / student))
        except PhotositeError as error:
            yield f"`{student}`: refused. {_text(error, folder)}"
            continue
        yield Figure(f"K of `{student}`, e⁻/DN", "0.46 (E-GAIN)", result.system_gain_dn_per_e, inverse=True)
        found = [entry for entry in result.diagnostics if entry.id == "unsteady-light"]
        yield from (f"`{student}`: {entry.id}. {_sentence(str(entry))}" for entry in found)


def industrial_darks(folder: Path) -> Iterator[Figure | str]:
    """Dark frames of a Flea3 in two sessions."""
    place = folder / "demo_data" / "captured_images" / "dark_frames"
    for session in ("d1", "d2"):
        entry = "kind: dark, exposure: 0.025, files: '{data}/" + session + "_dark_25ms*'"
        with protocol(place, entry) as path:
            try:
                ps.calibrate(ps.open_frames(path))
            except PhotositeError as error:
                yield f"Session {session}: refused. {_text(error, path.parent)}"


def scmos_maps(folder: Path) -> Iterator[Figure | str]:
    """Maps of variance and gain of an sCMOS camera."""
    maps = ps.read_camera_maps([folder / "varsub.mat", folder / "gainsub.mat"])
    chip = maps.chip()
    yield from (f"{_sentence(note)}" for note in maps.notes)
    yield f"{chip.shape[0]} x {chip.shape[1]} pixels, K {chip.system_gain_dn_per_e:.4g} DN/e⁻ (median)."


def _text(error: PhotositeError, folder: Path) -> str:
    return _sentence(str(error).replace(f"{folder}/", "").replace("protocol.yaml: ", ""))


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"


SETS = (
    PublicSet(
        "EMVA1288_ReferenceSet_001_CCD_12Bit",
        "EMVA reference set 001",
        "github.com/EMVA1288/datasets (Basler AG, CC BY-SA 3.0)",
        "300 frames of a 12-bit CCD. Published: figures of the EMVA's reference implementation.",
        ccd_of_emva,
        "[Its own page](emva-reference.md) has all figures, and the reason for each difference.",
    ),
    PublicSet(
        "EMVA1288_ReferenceSet_002_CMOS_08Bit",
        "EMVA reference set 002",
        "github.com/EMVA1288/datasets (STEMMER IMAGING, CC BY-SA 3.0)",
        "600 frames of an 8-bit CMOS. The reference implementation (1.0.2) was run on it.",
        cmos_of_emva,
        "The exposures start at 0, which a shutter that stays closed takes. The list has two flaws, which the "
        "diagnostics above name: its times are microseconds, where the format has nanoseconds, and the flat fields of "
        "the 50 % stack, listed with 140 and 947.92 photons, have the light of 1660, 11 260 photons. The dark "
        "variance, 0.10 DN² with its rounding, is below what 8 bits show.",
    ),
    PublicSet(
        "EMVA1288_ReferenceSet_003_Simulation_12Bit",
        "EMVA reference set 003",
        "github.com/EMVA1288/datasets (HCI, University of Heidelberg)",
        "302 simulated frames, whose truth the list states. The reference implementation (1.0.2) was run on it.",
        simulation_of_emva,
        "The light of the list is that in the middle. A fit of the 100 flat fields shows a fall of 1.49 % to the edge "
        "of each axis and a tilt: the mean is 0.9901 of the middle. The flat fields of the 50 % stack are listed with "
        "the photons of step 24 and have those of step 25: `wrong-light-levels` names this one of the 50 levels, and "
        "its light is not used. The reference uses it, and fits straight lines through a response that bends by "
        "design.",
    ),
    PublicSet(
        "msfc-ccd",
        "CCD230-42 of a sounding rocket",
        "the package msfc-ccd 1.2.0 (PyPI, BSD-3-Clause): the folders of `msfc_ccd/_data`",
        "Two flat fields and two dark frames (gzip-compressed FITS) of the ESIS channel 1 camera, 2152 x 1040 pixels, "
        "four amplifiers. Published: gains at small signal from 37 levels of light, checked with an iron-55 source.",
        sounding_rocket,
        "The flat fields have 12 000 to 24 000 DN. There, the owners' ratio of signal to variance is 1 to 3 % above "
        "the gain at small signal, because brighter pixels repel charge. The covariances with the neighbors contain "
        "this variance, and K from their sum is the gain at small signal. The dark noise has an interference that is "
        "correlated by 0.3 between pixels; it was taken for a filter in the camera until this set was tried.",
    ),
    PublicSet(
        "CCDChar",
        "SBIG ST-7 of a university course",
        "github.com/Astr480/CCDChar",
        "Five bias frames and three flat fields of 6 s (657 x 495 pixels, FITS). Published: gain and read noise of the "
        "course, and the gain that the camera states.",
        students_ccd,
        "The amplifier is slow for the pixel clock: each pixel has -1.5 % of the one before, in dark frames -3.3 %. "
        "This was taken for a filter in the camera until this set was tried. K comes from summed covariances, and half "
        "of the correction (3 %) is in its uncertainty.",
    ),
    PublicSet(
        "CCDChar",
        "The same course: whole folders",
        "github.com/Astr480/CCDChar",
        "The folders of two students, with flat fields under several lamps and one frame for most exposure times.",
        students_whole_folder,
        "In the first folder, flat fields of 6 s are those of another lamp than the series. In the second, the three "
        "flat fields of 29.5 s differ by 13 % in light, which varies by a factor of five over the frame: what the lamp "
        "changes is not uniform, and the interval of K says so. The student's own value is 0.312.",
    ),
    PublicSet(
        "chromatic-aberration",
        "Dark frames of an industrial camera",
        "github.com/bllanos/chromatic-aberration: `demo_data/captured_images/dark_frames`",
        "Dark frames of a FLIR Flea3 (ICX655, TIFF) with brightness 0 %, two for each of seven exposure times.",
        industrial_darks,
        "With a black level of 0, less than 1 % of the numbers are above 0. Their owner subtracts them; a noise "
        "cannot be told from them.",
    ),
    PublicSet(
        "sCMOS-noise-corrected-SIM",
        "Maps of an sCMOS camera",
        "github.com/ZB20-PKU/sCMOS-noise-corrected-SIM (Zhou et al., Photonics 9 (2022) 172; MIT)",
        "`varsub.mat` and `gainsub.mat`, 512 x 512 pixels.",
        scmos_maps,
        "The gain of eleven defective pixels is negative in the published map; the map was refused for them until "
        "this set was tried.",
    ),
)

INTRODUCTION = """# Real frames

Sets of frames that others published, calibrated by photosite beside what their owners say. The data are not part of the
repository. Collect them in a folder under the names in brackets, and make this page:

    make real-frames DATA=folder

*Interval* is whether photosite's 95 % interval contains the owner's value, which has an uncertainty of its own.
"""


def section(each: PublicSet, data: Path) -> str:
    """Return the section of a set."""
    lines = [f"\n## {each.title}\n", f"{each.holds}\n", f"Source: {each.source} (`{each.folder}`).\n"]
    folder = data / each.folder
    if not folder.is_dir():
        return "\n".join([*lines, "The set was not at hand when this page was made."])
    rows: list[Figure] = []
    notes: list[str] = []
    try:
        for found in each.rows(folder):
            (rows if isinstance(found, Figure) else notes).append(found)  # type: ignore[arg-type]
    except PhotositeError as error:
        notes.append(f"Refused: {_text(error, folder)}")
    if rows:
        lines += ["| figure | owner | photosite | interval | reason |", "|---|---|---|---|---|"]
        lines += [f"| {' | '.join(row.cells())} |" for row in rows]
        lines.append("")
    lines += [f"- {note}" for note in notes] + ([""] if notes else [])
    return "\n".join([*lines, each.shows]).rstrip()


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--page", type=Path, default=PAGE)
    chosen = parser.parse_args()
    if not chosen.data.is_dir():
        parser.error(f"{chosen.data}: there is no such folder")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sections = [section(each, chosen.data) for each in SETS]
    chosen.page.write_text("\n".join([INTRODUCTION.rstrip(), *sections]) + "\n", encoding="utf-8")
    print(f"wrote {chosen.page}")


if __name__ == "__main__":
    main()
