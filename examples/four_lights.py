"""
White balance under four lights
===============================

A ColorChecker photographed under four lights. Left: as the sensor reads it. Right: white-balanced for the light.
Under fluorescent lamps and LEDs some colors remain wrong, because the sensor is no colorimeter.
"""

import matplotlib.pyplot as plt
from drawing import d200, panels, shoot

import photosite as ps

LIGHTS = {"CIE A": "A", "D65": "D65", "FL11, fluorescent": "FL11", "LED-B3, white LED": "LED-B3"}
camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), d200(244, 362))
shown = []
for name, light in LIGHTS.items():
    raw = shoot(camera, ps.charts.macbeth(light, 100))
    shown.append([(name, ps.develop(raw, "none")), ("white-balanced", ps.develop(raw))])
panels(shown)
plt.show()
