"""A scene rendered by Mitsuba 3 in 31 bands, and the same scene photographed. Needs the extra `render`."""

from drawing import d200, panels, photograph, save

import photosite as ps
from photosite.scene.scene import preview

scene = ps.render.example_scene(rows=240, cols=360)
seen = preview(scene, white_xy=(0.4234, 0.3990))  # adapted to the lamp, a blackbody of 3200 K
lens = ps.DiffractionLimited(f_number=4, focal_length_mm=4.4)  # short, so that few pixels span the scene
picture = photograph(ps.Camera(lens, d200(240, 360)), scene, "3200K")
figure, _ = panels([[("the scene", seen), ("Nikon D200, 240 x 360 pixels, f/4", picture)]])
save(figure, "still-life.jpg")
