"""Settings that differ in more than kind, exposure and gain are never merged."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from raising import raises

import photosite as ps
from photosite.calibration.settings_result import SettingsCalibration
from photosite.cli.calibrate import command
from photosite.cli.main import run
from photosite.errors import FileError, InputError
from photosite.frames.conditions import CONDITIONS, label, parse_where, stated_conditions
from photosite.frames.open import open_settings

fits = pytest.importorskip("astropy.io.fits")


def put(folder, name, shape=(4, 6), **keywords):
    folder.mkdir(exist_ok=True)
    header = fits.Header({"EXPTIME": 1.0, **{key.replace("_", "-"): value for key, value in keywords.items()}})
    fits.PrimaryHDU(np.full(shape, 64, np.uint16), header).writeto(folder / f"{name}.fits")


@pytest.mark.parametrize(
    ("first", "second", "found"),
    [
        ({"READOUTM": "Fast"}, {"READOUTM": "High Gain"}, ["read_mode=Fast", "read_mode=High Gain"]),
        ({"OFFSET": 10}, {"OFFSET": 50}, ["offset_setting=10", "offset_setting=50"]),
        ({"BLKLEVEL": 10}, {"BLKLEVEL": 50}, ["offset_setting=10", "offset_setting=50"]),
        ({"XBINNING": 1, "YBINNING": 1}, {"XBINNING": 2, "YBINNING": 2}, ["binning=1x1", "binning=2x2"]),
        ({"CCDSUM": "1 1"}, {"CCDSUM": "2 1"}, ["binning=1x1", "binning=2x1"]),
        ({"XORGSUBF": 0, "YORGSUBF": 0}, {"XORGSUBF": 8, "YORGSUBF": 2}, ["subframe=6x4+0+0", "subframe=6x4+8+2"]),
        ({"SET_TEMP": -10.0}, {"SET_TEMP": -20.0}, ["set_temperature_c=-10", "set_temperature_c=-20"]),
        ({"FILTER": "B"}, {"FILTER": "R"}, ["filter=B", "filter=R"]),
        ({"INSTRUME": "ASI1600"}, {"INSTRUME": "ASI294"}, ["camera=ASI1600", "camera=ASI294"]),
        ({"SERIALNO": "A1"}, {"SERIALNO": "A2"}, ["serial_number=A1", "serial_number=A2"]),
    ],
)
def test_conditions_of_fits(tmp_path, first, second, found):
    put(tmp_path, "a", IMAGETYP="FLAT", **first)
    put(tmp_path, "b", IMAGETYP="FLAT", **second)
    settings = open_settings(tmp_path)
    assert [label(each.conditions) for each in settings] == found
    assert [each.frame_count for each in settings] == [1, 1]
    with raises(FileError, f"the frames have 2 settings: {found[0]} (1 frame); {found[1]} (1 frame)"):
        ps.open_frames(tmp_path)
    one = ps.open_frames(tmp_path, where=found[1])
    assert one.groups[0].frames[0].name.endswith("b.fits")


def test_settings_may_differ_in_size(tmp_path):
    put(tmp_path, "a", (4, 6), IMAGETYP="FLAT", XBINNING=1, YBINNING=1)
    put(tmp_path, "b", (2, 3), IMAGETYP="FLAT", XBINNING=2, YBINNING=2)
    assert [(each.rows, each.cols) for each in open_settings(tmp_path)] == [(4, 6), (2, 3)]


def test_dark_frames_go_with_each_filter(tmp_path):
    for mode in ("fast", "slow"):
        put(tmp_path, f"dark_{mode}", IMAGETYP="DARK", FILTER="none", READOUTM=mode)
        for color in "RG":
            put(tmp_path, f"{color}_{mode}", IMAGETYP="FLAT", FILTER=color, READOUTM=mode)
    settings = open_settings(tmp_path)
    names = {
        label(each.conditions): sorted(f.path.stem for group in each.groups for f in group.frames) for each in settings
    }
    assert names == {
        f"read_mode={mode},filter={color}": [f"{color}_{mode}", f"dark_{mode}"]
        for mode in ("fast", "slow")
        for color in "GR"
    }
    chosen = ps.open_frames(tmp_path, where={"filter": "r", "read_mode": "slow"})
    assert [group.kind for group in chosen.groups] == ["dark", "light"]


def test_dark_frames_without_flat_fields_of_their_setting_are_listed(tmp_path):
    put(tmp_path, "dark_1", IMAGETYP="DARK", XBINNING=1, YBINNING=1)
    put(tmp_path, "flat_R", IMAGETYP="FLAT", XBINNING=1, YBINNING=1, FILTER="R")
    put(tmp_path, "flat_G", IMAGETYP="FLAT", XBINNING=1, YBINNING=1, FILTER="G")
    put(tmp_path, "dark_2", IMAGETYP="DARK", XBINNING=2, YBINNING=2)
    assert sorted((label(each.conditions), each.frame_count) for each in open_settings(tmp_path)) == [
        ("binning=1x1,filter=G", 2),
        ("binning=1x1,filter=R", 2),
        ("binning=2x2,filter=not stated", 1),
    ]


def test_what_one_frame_states_alone_does_not_separate(tmp_path):
    put(tmp_path, "a", IMAGETYP="DARK")
    put(tmp_path, "b", IMAGETYP="FLAT", READOUTM="fast")
    assert ps.open_frames(tmp_path).frame_count == 2
    put(tmp_path, "c", IMAGETYP="FLAT", READOUTM="slow")
    assert [label(each.conditions) for each in open_settings(tmp_path)] == [
        "read_mode=fast",
        "read_mode=not stated",
        "read_mode=slow",
    ]
    assert len(open_settings(tmp_path, together=("read_mode",))) == 1


def test_set_point_of_a_camera_without_cooler():
    """N.I.N.A. wrote -1.8e308 for an unknown one."""
    assert stated_conditions({"set_temperature_c": -1.7e308, "camera": "x"}) == {"camera": "x"}


def test_a_model_is_a_camera():
    assert stated_conditions({"make": "A", "model": "B"}) == {"camera": "B"}


def test_a_protocol_states_conditions(tmp_path):
    for name in "ab":
        put(tmp_path, name, FILTER="L")
    text = "photosite_protocol: 1\nframes:\n- {kind: light, files: a.fits%s}\n- {kind: light, files: b.fits%s}\n"
    (tmp_path / "protocol.yaml").write_text(text % (", filter: R", ", filter: 2"))
    assert [label(each.conditions) for each in open_settings(tmp_path)] == ["filter=2", "filter=R"]
    (tmp_path / "protocol.yaml").write_text(text % ("", ""))
    assert ps.open_frames(tmp_path).frame_count == 2


def test_pictures_of_the_sky_are_no_flat_fields(tmp_path):
    for number, kind in enumerate(("Dark", "DARKFLAT", "FLAT", "Flat Frame", "LIGHT", "Light Frame", "OBJECT")):
        put(tmp_path, f"a{number}", IMAGETYP=kind, EXPTIME=0.1)
    frames = ps.open_frames(tmp_path)
    assert [(group.kind, len(group)) for group in frames.groups] == [("dark", 2), ("light", 2)]
    assert [entry.size for entry in frames.diagnostics if entry.id == "pictures-left-out"] == [3]
    frames = ps.open_frames(tmp_path, light="a[4-6]*")
    assert [(group.kind, len(group)) for group in frames.groups] == [("dark", 2), ("light", 5)]


def test_frames_of_type_light_are_flat_fields_where_there_are_no_others(tmp_path):
    for number, kind in enumerate(("Dark", "LIGHT")):
        put(tmp_path, f"a{number}", IMAGETYP=kind)
    assert [group.kind for group in ps.open_frames(tmp_path).groups] == ["dark", "light"]


@pytest.mark.parametrize(
    ("keyword", "value", "kind"),
    [
        ("OBSTYPE", "zero", "dark"),
        ("OBSTYPE", "dome flat", "light"),
        ("OBSTYPE", "SKYFLAT", "light"),
        ("HIERARCH ESO DPR TYPE", "LAMP,FLAT", "light"),
        ("HIERARCH ESO DPR TYPE", "BIAS", "dark"),
        ("FRAME", "Dark", "dark"),
        ("IMAGETYP", "FlatDark", "dark"),
        ("IMAGETYP", "Dark Flat", "dark"),
    ],
)
def test_keywords_of_the_kind(tmp_path, keyword, value, kind):
    put(tmp_path, "a", **{keyword: value})
    assert [group.kind for group in ps.open_frames(tmp_path).groups] == [kind]


@pytest.mark.parametrize(("where", "value"), [("filter", "filter"), ("color=R", "color"), ("filter=U", "filter=U")])
def test_invalid_selections(tmp_path, where, value):
    put(tmp_path, "a", IMAGETYP="FLAT", FILTER="R")
    with raises(InputError, "where", value=value):
        ps.open_frames(tmp_path, where=where)


def test_selections():
    assert parse_where(["filter=R,binning=2x2", "part=A"]) == {"filter": "R", "binning": "2x2", "part": "A"}
    assert parse_where({"set_temperature_c": -10.0}) == {"set_temperature_c": "-10"}
    assert set(parse_where(",".join(f"{name}=1" for name in CONDITIONS))) == set(CONDITIONS)


@pytest.mark.parametrize("where", [["filter=R", "filter=G"], "filter=R,Filter=R", {"filter": "R", "FILTER": "G"}])
def test_a_name_is_given_once(where):
    with raises(InputError, "where", expected="each name once"):
        parse_where(where)


@pytest.mark.parametrize("where", ["binning=2", "Binning=2X2", "BINNING=2 x 2", "binning=2×2", {"binning": 2}])
def test_equal_meaning_selects_the_same_frames(tmp_path, where):
    for binning in (1, 2):
        put(tmp_path, f"b{binning}", IMAGETYP="FLAT", XBINNING=binning, YBINNING=binning)
        frame = ps.RawFrame(np.ones((4, 6), np.uint16), 16, exposure_s=1, metadata={"kind": "dark", "binning": binning})
        frame.save(tmp_path / f"d{binning}.png")
    assert [each.conditions["binning"] for each in open_settings(tmp_path, cfa="mono")] == ["1x1", "2x2"]
    assert ps.open_frames(tmp_path, cfa="mono", where=where).frame_count == 2
    with raises(InputError, "where", value="binning=2x1"):
        ps.open_frames(tmp_path, where="binning=2x1")


def test_gain_settings_are_selected_and_not_separated(tmp_path):
    for gain in (0, 100):
        put(tmp_path, f"g{gain}", IMAGETYP="FLAT", GAIN=gain)
    assert ps.open_frames(tmp_path).gain_settings == (0, 100)
    assert ps.open_frames(tmp_path, where="gain_setting=100").gain_settings == (100,)


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Two read modes of 0.25 and 0.5 DN/e-, and dark frames of a third one."""
    rng, folder = np.random.default_rng(1), tmp_path_factory.mktemp("modes")
    for mode, gain in (("high", 0.5), ("low", 0.25)):
        for kind, electrons in (("dark", 0), *(("flat", n) for n in range(500, 4500, 500))):
            for number in range(3):
                dn = 64.5 + gain * (rng.poisson(electrons, (48, 48)) + 3 * rng.standard_normal((48, 48)))
                metadata = {"read_mode": mode, "kind": "dark" if kind == "dark" else "light"}
                frame = ps.RawFrame(dn.astype(np.uint16), 12, exposure_s=(electrons or 500) / 1e4, metadata=metadata)
                frame.save(folder / f"{mode}_{electrons}_{number}.tif")
    ps.RawFrame(np.zeros((48, 48), np.uint16), 12, exposure_s=1.0, metadata={"read_mode": "odd", "kind": "dark"}).save(
        folder / "odd.tif"
    )
    return folder


def test_calibration_of_each_setting(measured):
    found = ps.calibrate(open_settings(measured))
    assert isinstance(found, SettingsCalibration)
    assert list(found.settings) == ["read_mode=high", "read_mode=low"]
    for each, gain in zip(found.settings.values(), (0.5, 0.25), strict=True):
        low, high = each.system_gain_dn_per_e.interval_95
        assert low < gain < high < 1.1 * gain
    assert list(found.refused) == ["read_mode=odd"]
    assert found.diagnostics[0].id == "setting-not-calibrated"


@pytest.mark.filterwarnings("default::photosite.errors.PhotositeWarning")
@pytest.mark.parametrize("output", [False, True])
def test_status_tells_whether_a_setting_failed(measured, tmp_path, capsys, output):
    """One of three fails, none of two, all of two; the others are shown and written."""

    def status(folder):
        written = tmp_path / f"{folder.name}.sensor.yaml"
        done = run(["calibrate", str(folder), *(["--sensor", "sony-imx174", "-o", str(written)] if output else [])])
        return done, len(list(tmp_path.glob(f"{folder.name}.*.yaml")))

    for name, modes in (("both", ("high", "low")), ("none", ("odd", "even"))):
        (tmp_path / name).mkdir()
        for mode in modes:
            for path in measured.glob(f"{'odd' if mode == 'even' else mode}*"):
                frame = ps.read_raw(path)
                metadata = {**frame.metadata, "read_mode": mode}
                replace(frame, metadata=metadata).save(tmp_path / name / f"{mode}_{path.name}")
    assert status(measured) == (2, 2 * output)
    assert "1 of 3 settings failed: read_mode=odd" in capsys.readouterr().err
    assert status(tmp_path / "both") == (0, 2 * output)
    assert status(tmp_path / "none") == (2, 0)
    assert "2 of 2 settings failed: read_mode=even; read_mode=odd" in capsys.readouterr().err


def test_command_lists_settings_and_calibrates_each_or_one(measured, tmp_path):
    done = CliRunner().invoke(command, [str(measured), "--json"])
    assert done.exit_code == 0, done.output
    assert done.stderr.splitlines()[:4] == [
        f"photosite: {measured} has 3 settings. Each is calibrated; --where chooses one",
        "  read_mode=high: 27 frames",
        "  read_mode=low: 27 frames",
        "  read_mode=odd: 1 frame",
    ]
    assert [each["conditions"][10:] for each in json.loads(done.stdout)["settings"]] == ["high", "low", "odd"]
    one = CliRunner().invoke(command, [str(measured), "--json", "--where", "read_mode=low"])
    low, high = json.loads(one.stdout)["parameters"]["system_gain_dn_per_e"]["interval_95"]
    assert low < 0.25 < high


@pytest.mark.filterwarnings("default::photosite.errors.PhotositeWarning")
def test_sensor_file_of_each_setting(measured, tmp_path):
    arguments = [str(measured), "--sensor", "sony-imx174", "-o", str(tmp_path / "a.sensor.yaml")]
    done = CliRunner().invoke(command, [*arguments, "--json"])
    assert done.exit_code == 0, done.output
    names = {"read_mode=high": "a.high.sensor.yaml", "read_mode=low": "a.low.sensor.yaml"}
    assert json.loads(done.stdout)["sensors"] == {setting: str(tmp_path / name) for setting, name in names.items()}
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names.values())
    assert "no sensor file for read_mode=odd: " in done.stderr
    for (setting, name), gain in zip(names.items(), (0.5, 0.25), strict=True):
        sensor = ps.load_sensor(tmp_path / name)
        assert sensor.name.endswith(f", {setting}")
        assert sensor.system_gain_dn_per_e == pytest.approx(gain, rel=0.1)
    (tmp_path / "a.high.sensor.yaml").unlink()
    again = CliRunner().invoke(command, arguments)
    assert again.exit_code == 1
    assert "a.low.sensor.yaml: the file exists already" in again.output
    assert not (tmp_path / "a.high.sensor.yaml").exists()
    darks = CliRunner().invoke(command, [*arguments, "--where", "read_mode=odd"])
    assert darks.exit_code != 0
