"""EMVA results as XML, as read by the reference implementation, and units of all figures."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import pytest

import photosite as ps
from photosite.calibration.export.emva_xml import FIGURES, write_emva_results


def reference_reading(path):
    """Read a file as the reference implementation's `xml_to_dict` does: section, figure, number or None."""
    found = {}
    for section in ElementTree.parse(path).getroot():
        assert section.tag not in found
        found[section.tag] = {}
        for figure in section:
            text = figure.find("value").text
            found[section.tag][figure.tag] = None if text == "None" else float(text)
    return found


@pytest.fixture(scope="module", params=[True, False], ids=["metered", "unmetered"])
def measured(request, virtual, tmp_path_factory):
    sensor = virtual.sensor(3, rows=48, cols=64)
    frames = virtual.frame_set(sensor, 3, photons_known=request.param, dark_frames=8, stack=6, repeats=2)
    calibration = ps.calibrate(frames)
    path = tmp_path_factory.mktemp("emva") / "results.xml"
    write_emva_results(calibration, path)
    return calibration, path


def test_figures_in_the_sections_of_the_reference(measured):
    calibration, path = measured
    found = reference_reading(path)
    assert set(found) == {"sensitivity", "linearity", "dark_current", "spatial", "photosite"}
    assert sum(map(len, found.values())) == sum(map(len, FIGURES.values())) + len(calibration.estimates())
    sensitivity, gain = found["sensitivity"], calibration.by_line.system_gain_dn_per_e.value
    assert sensitivity["K"] == gain
    assert sensitivity["inverse_K"] == pytest.approx(1 / gain, rel=1e-14)
    noise_dn = math.sqrt((sensitivity["sigma_d"] * gain) ** 2 + 1 / 12)
    assert sensitivity["sigma_y_dark"] == pytest.approx(noise_dn, rel=1e-12)
    capacity = sensitivity["u_e_sat"]
    assert sensitivity["SNR_max"] == pytest.approx(math.sqrt(capacity), rel=1e-12)
    assert sensitivity["SNR_max_bit"] == pytest.approx(0.5 * math.log2(capacity), rel=1e-12)
    assert sensitivity["inverse_SNR_max"] == pytest.approx(100 / math.sqrt(capacity), rel=1e-12)
    assert sensitivity["SNR_max_dB"] == pytest.approx(10 * math.log10(capacity), rel=1e-12)
    assert sensitivity["DR"] == pytest.approx(10 ** (sensitivity["DR_dB"] / 20), rel=1e-12)
    assert sensitivity["u_e_min"] == pytest.approx(capacity / sensitivity["DR"], rel=1e-12)
    assert sensitivity["u_e_sat_area"] == pytest.approx(capacity / 25.0, rel=1e-12)  # 5 um pixels
    assert found["spatial"]["DSNU1288_DN"] == pytest.approx(found["spatial"]["DSNU1288"] * gain, rel=1e-12)
    assert found["spatial"]["PRNU1288"] == calibration.by_line.prnu1288_unfiltered_percent.value
    assert found["linearity"]["LE_min"] == calibration.linearity_error_min_percent.value
    assert found["linearity"]["LE_max"] == calibration.linearity_error_max_percent.value
    for name in ("u_I_mean", "u_I_var"):
        electrons_per_s = found["dark_current"][name]
        assert electrons_per_s is not None
        assert found["dark_current"][f"{name}_DN"] == pytest.approx(electrons_per_s * gain, rel=1e-12)
    if sensitivity["QE"] is not None:
        assert sensitivity["u_e_min"] == pytest.approx(sensitivity["QE"] / 100 * sensitivity["u_p_min"], rel=1e-9)


def test_uncertainties_units_and_reasons(measured):
    calibration, path = measured
    root = ElementTree.parse(path).getroot()
    for name, entry in calibration.estimates().items():
        figure = root.find(f"photosite/{name}")
        if entry.value is None:
            assert figure.findtext("value") == "None"
            assert figure.findtext("reason") == entry.reason
            assert figure.find("standard_uncertainty") is None
        else:
            assert float(figure.findtext("value")) == entry.shown_value
            assert float(figure.findtext("standard_uncertainty")) == entry.standard_uncertainty
            assert tuple(map(float, figure.findtext("interval_95").split())) == entry.interval_95
        assert figure.findtext("method") == entry.method
    assert root.findtext("photosite/system_gain_dn_per_e/unit") == "DN/e⁻"
    inverse = root.find("sensitivity/inverse_K")
    gain = calibration.by_line.system_gain_dn_per_e
    relative = gain.standard_uncertainty / gain.value
    assert float(inverse.findtext("standard_uncertainty")) / float(inverse.findtext("value")) == pytest.approx(relative)
    assert inverse.findtext("unit") == "$e^-/DN$"
    assert "without the high-pass" in root.findtext("spatial/PRNU1288/method")
    assert "not in the file" in root.get("note")


def test_channels_have_separate_sections(virtual, tmp_path):
    sensor = virtual.sensor(4, rows=48, cols=64, cfa="rggb")
    calibration = ps.calibrate(virtual.frame_set(sensor, 4, dark_frames=6, stack=4, repeats=2))
    write_emva_results(calibration, tmp_path / "results.xml")
    found = reference_reading(tmp_path / "results.xml")
    for channel in "RGB":
        expected = calibration.channels[channel].quantum_efficiency_percent.value
        assert found[f"photosite_{channel}"]["quantum_efficiency_percent"] == expected
