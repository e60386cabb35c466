"""False colors on a zone plate, and what an optical low-pass filter leaves of them."""

from drawing import auto_exposure_s, d200, panels, photograph, save

import photosite as ps

plate = ps.charts.zone_plate("D65", 100, highest=0.5, rows=1260, cols=1260)
lens = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
bare = d200(420, 420)
pitch_um = bare.pixel.width_um.value
filtered = bare.with_(low_pass_filter={"split_x_um": pitch_um, "split_y_um": pitch_um})
exposure_s = auto_exposure_s(ps.Camera(lens, bare, cells_per_pixel=3), plate)
shown = [
    (title, photograph(ps.Camera(lens, sensor, cells_per_pixel=3), plate, "D65", exposure_s, 1.5))
    for title, sensor in (("no low-pass filter", bare), (f"four spots, {pitch_um:g} µm apart", filtered))
]
figure, _ = panels([shown])
save(figure, "low-pass-filter.jpg")
