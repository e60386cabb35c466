"""A ColorChecker photographed under four lights, without and with white balance."""

from drawing import auto_exposure_s, d200, panels, photograph, save

import photosite as ps

LIGHTS = {"CIE A": "A", "D65": "D65", "FL11, fluorescent": "FL11", "LED-B3, white LED": "LED-B3"}
camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), d200(150, 222))
unbalanced, balanced = [], []
for name, light in LIGHTS.items():
    chart = ps.charts.macbeth(light, 100)
    raw = camera.capture(chart, auto_exposure_s(camera, chart), seed=2008)
    unbalanced.append((name, ps.develop(raw, "none")))
    balanced.append(("white-balanced", photograph(camera, chart, light)))
figure, _ = panels([unbalanced, balanced])
save(figure, "four-lights.jpg")
