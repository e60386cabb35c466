"""The figure of quantum efficiency shows the given numbers."""

from __future__ import annotations

import numpy as np
import pytest

import photosite as ps
from photosite.calibration.spectral.result import BandReading, ChannelEfficiency, SpectralCalibration
from photosite.report.figures.sensor import quantum_efficiency_figure
from photosite.report.style import png_bytes

NM = np.array([450.0, 550.0, 650.0])


def calibration(bands: bool) -> SpectralCalibration:
    channels = {
        name: ChannelEfficiency(NM, peak * np.array([0.5, 1.0, 0.7]), np.diag([1e-4, 4e-4, 1e-4]), None, 0.0, "by hand")
        for name, peak in (("R", 0.4), ("G", 0.6))
    }
    reading = tuple(BandReading(f"{nm:g} nm", nm, 5.0, 0.1, 1e15, 1e12) for nm in NM) if bands else ()
    return SpectralCalibration(channels, reading, "lamps", ps.load_sensor("nikon-d200"), "memory", 3, (), ())


@pytest.mark.parametrize("bands", [True, False])
def test_every_channel_has_a_panel_with_its_values(bands: bool) -> None:
    figure = quantum_efficiency_figure(calibration(bands), ps.load_sensor("nikon-d200"))
    assert len(figure.axes) == 2
    green = figure.axes[1]
    assert "G" in green.get_ylabel()
    assert any(
        line.get_xdata().shape == NM.shape and np.allclose(line.get_ydata(), [30.0, 60.0, 42.0]) for line in green.lines
    )
    assert "Nikon D200" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert png_bytes(figure).startswith(b"\x89PNG")
