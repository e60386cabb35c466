"""The gallery's pictures, in the order light travels: scenes, lenses, what lies on the chip, what is measured of it."""

from __future__ import annotations

from photosite.studies.gallery.page import Entry

_SCENES = (
    Entry(
        "patterns",
        "Patterns by formula",
        "A sample of the scene a pixel, without a camera. Edges stand where the formula puts them, between "
        "samples too; the sweep and the zone plate go to the grid's finest frequency and fade there, since a "
        "sample is the mean over its own square.",
        "patterns:patterns_plate",
    ),
    Entry(
        "colour-charts",
        "Two ColorCheckers",
        "Under D65, as an eye sees them. The Classic's reflectances were measured; the SG's are smooth spectra "
        "with the published colours under D50.",
        "patterns:colour_charts_plate",
    ),
    Entry(
        "lights",
        "A chart under four lights, and under two at once",
        "As an eye adapted to daylight sees it: the same reflectances, another light. Below right daylight comes "
        "from the left and CIE A falls on the right, so that no one spectrum lights the scene.",
        "pictures:lights_plate",
    ),
    Entry(
        "pictures",
        "Pictures raised to spectra",
        "Above: five patches of the ColorChecker, measured, and what is left of them when their sRGB values are "
        "raised to reflectances again; all three have the same colour under D65 (cyan is clipped to "
        "sRGB). Below: a picture of light over six decades, a decade darker from column to column, with three "
        "luminances shown as white.",
        "pictures:pictures_plate",
    ),
    Entry(
        "cube",
        "A spectral cube's file and back",
        "A chart under daylight from the left and a lamp on the right, written as a TIFF of one page a band and "
        "read again: reduced to the fewest spectra that keep the radiance to 0.1 % of its RMS. Lines were "
        "written, points read.",
        "cube_file:cube_round_trip",
    ),
    Entry(
        "still-life",
        "A scene from a renderer",
        "Mitsuba 3 renders painted things under a lamp of 3200 K in 31 bands, in W/sr/m²/nm. Left as an eye "
        "adapted to the lamp sees it, right by a D200 at f/4 (4.4 mm, so that a few pixels span the scene), gray "
        "made gray, with its noise.",
        "renders:still_life",
        noisy=True,
        extra="render",
    ),
    Entry(
        "six-decades",
        "Six decades of light through a camera",
        "36 greys from 35 000 to 0.035 cd/m² by a D200 at f/4. An exposure reads about three decades between full"
        " scale and noise. What the darkest patches read is not theirs: it is the wings of diffraction around the"
        " brightest, which no exposure takes away.",
        "high_range:six_decades",
    ),
    Entry(
        "low-light",
        "A face in little light",
        "One portrait (Commodore Grace M. Hopper, U.S. Navy, 1984, public domain) under CIE A, mean luminance "
        "500, 50 and 5 cd/m², by a D200 at f/8 and 1/60 s; each developed so that a white surface is white. Over "
        "each: luminance of the face, electrons of its green pixels, and their signal-to-noise ratio with the "
        "chip's fixed pattern.",
        "low_light:low_light",
        noisy=True,
    ),
)

_LENSES = (
    Entry(
        "points",
        "Points and transfer functions",
        "Eight lenses of f/4 at 550 nm: the image of a point over four decades of irradiance, relative to the "
        "perfect lens's peak, and the MTF across and down. Aberrations are Zernike terms of 80 nm RMS.",
        "optics:optics_plate",
    ),
    Entry(
        "modes",
        "A blur that varies over the field, by a few modes",
        "f/2.8 at 550 nm; at the corner 0.8 waves of coma and 0.3 of field curvature. The engine adds up a few "
        "modes, weighted over the field; the error falls with their number until only interpolation between the "
        "17 x 17 places where point spreads are known remains (0.3 % RMS). Pixels of 2.2 µm; pictures in square "
        "root.",
        "lens_design:low_rank_figure",
    ),
    Entry(
        "coma",
        "Stars through that lens",
        "Siemens stars on 240 x 400 green pixels of 1.4 µm. The middle keeps its spokes; in the corner coma and "
        "defocus take the fine ones.",
        "field:coma_over_the_field",
    ),
    Entry(
        "distortion",
        "Distortion and lateral colour",
        "A checkerboard by a D200 behind 24 mm at f/5.6: straight; a barrel of 6 % at the corner; red 0.6 % "
        "smaller and blue 0.6 % larger than green, which puts colours on edges away from the middle. The fringes "
        "of one pixel that all have are the demosaicing's.",
        "geometry:distortion",
    ),
    Entry(
        "glare",
        "Veiling glare",
        "A ColorChecker beside a window a hundred times as bright as its white, at f/4; 1 % of all light "
        "scattered, evenly or falling as exp(-distance / 0.5 mm). Over each: electrons of green pixels on the "
        "white patch over those on the black one. Without glare, diffraction's wings round the window are what "
        "makes it less than the chart's own 26.",
        "glare:veiling_glare",
    ),
    Entry(
        "focus",
        "Planes in depth",
        "Slats at 1.7 m, a ColorChecker at 2 m and dead leaves at 3 m through 50 mm at f/4, focused on each. What"
        " is in front hides what is behind, softly where it is out of focus.",
        "depth:focus",
        noisy=True,
    ),
    Entry(
        "bokeh",
        "The diaphragm's shape in points of light",
        "Points of light at 40 m, focus at 3 m, 50 mm at f/4: a round opening, six blades, and a mirror lens "
        "whose middle is dark. A disc is 32 pixels wide.",
        "depth:bokeh",
        noisy=True,
    ),
)

_SENSORS = (
    Entry(
        "four-lights",
        "One chart in four lights, through a camera",
        "The ColorChecker by a D200 at f/8. Above as the sensor reads it, below with gains that make gray gray: "
        "under fluorescent lamps and LEDs some colours stay wrong.",
        "through_a_camera:one_chart_in_four_lights",
        noisy=True,
    ),
    Entry(
        "low-pass-filter",
        "An optical low-pass filter",
        "A zone plate whose rings reach 1.5 cycles per pixel at the picture's border, by a D200 at f/4. Half a "
        "cycle per pixel is what the colour filter array takes for colour; the filter has its zero there.",
        "door:low_pass_filter",
        noisy=True,
    ),
    Entry(
        "crosstalk",
        "Crosstalk",
        "A ColorChecker by a D200 at f/8. Each of a pixel's four neighbours collects 4 % of a red pixel's light, "
        "2 % of a green one's and 1 % of a blue one's: colours lose chroma and edges sharpness. Gains make gray "
        "gray; both are developed by the matrix of the sensor without crosstalk.",
        "door:crosstalk",
        noisy=True,
    ),
    Entry(
        "slanted-edge",
        "Sharpness measured on raw frames",
        "An edge that leans by 5 degrees, on the mosaic's green pixels (6.05 µm) through four lenses: points are "
        "measured, lines are lens times low-pass filter times photodetector; below, their difference up to "
        "Nyquist.",
        "sharpness:slanted_edge_figure",
    ),
)

GALLERY: tuple[Entry, ...] = _SCENES + _LENSES + _SENSORS
