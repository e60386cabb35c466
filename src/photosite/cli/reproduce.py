"""`photosite reproduce`: studies that verify photosite, and the experiments of the 2008 paper."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Group
from photosite.cli.output import Stages, listed, say_if_compiling, show, table

if TYPE_CHECKING:
    from photosite.studies.coverage import Coverage, CoverageStudy
    from photosite.studies.farrell2008.fill_factor import Recovery
    from photosite.studies.image_quality import ImageQualityStudy
    from photosite.studies.random_sensors import RandomSensors

SENSORS, QUICK_SENSORS = 500, 50


CHARTS = 200


class _ConditionOption(click.Option):
    """--condition, whose help lists the conditions when it is shown: to import them takes seconds."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return name and help text."""
        from photosite.studies.conditions import CONDITIONS

        self.help = f"Study this condition only; repeatable. One of {', '.join(CONDITIONS)}."
        return super().get_help_record(ctx)


@click.group("reproduce", cls=Group)
def command() -> None:
    """Run a study of photosite on virtual cameras.

    Example: photosite reproduce coverage --quick
    """


@command.command("farrell2008")
@options.seed_option(2008)
@options.folder_option(
    options.output_folder, "Folder for the page, results.json and the figures.", default="farrell2008"
)
@click.option("--only", "chapters", multiple=True, metavar="CHAPTER", help="Run this chapter only; repeatable.")
@options.json_option
def farrell2008(seed: int, output: Path, chapters: tuple[str, ...], as_json: bool) -> None:
    """Reproduce the experiments of the 2008 paper.

    Farrell, Okincha and Parmar, "Sensor calibration and simulation": every table and figure beside the values of the
    paper, with the differences in words. The paper's frames were never published, so virtual cameras replace the real
    ones; the simulation does not know their hidden parameters. A few minutes on two cores.

    Example: photosite reproduce farrell2008 -o farrell2008
    """
    from photosite.files.writing import atomic_folder
    from photosite.studies.farrell2008.study import FIGURES_NAME, PAGE_NAME, RESULTS_NAME, reproduce

    stages = Stages()
    say_if_compiling()
    with atomic_folder(output) as place:
        study = reproduce(seed, chapters or None, stages)
        stages.stage("drawing the figures and writing the page")
        study.write(place)
    places = (("page", PAGE_NAME), ("numbers", RESULTS_NAME), ("figures", FIGURES_NAME))
    lines = [*(f"{what}: {output / name}" for what, name in places), f"{sum(study.seconds.values()):.0f} s"]
    show(as_json, study.to_dict(), lambda: "\n".join(lines))


@command.command("fill-factor")
@click.option("--seeds", type=options.Whole(1), default=100, help="Virtual cameras of each kind, with seeds 0, 1, ...")
@options.json_option
def fill_factor(seeds: int, as_json: bool) -> None:
    """Test the fit of the fill factor on virtual cameras.

    Each seed gives another virtual D200 and another vendor camera: another fill factor near the paper's, other fixed
    pattern and noise, a lamp in another direction. `found` is the fraction of fits within two standard errors of the
    truth, `pull` the error in standard errors. 100 seeds take two minutes.

    Example: photosite reproduce fill-factor --seeds 10
    """
    from photosite.studies.farrell2008.fill_factor import recovery_study

    stages = Stages()
    say_if_compiling()
    stages.stage(f"fitting the fill factor of {seeds} cameras of each kind")
    found = recovery_study(range(seeds), progress=lambda done, total: stages(done, total, "fits"))
    heading = ("camera", "seeds", "found", "in 95 % interval", "standard error", "mean pull", "rms pull", "largest")
    content = {recovery.case.key: recovery.to_dict() for recovery in found}
    show(as_json, content, lambda: table([heading, *map(_recovery_line, found)], "<>>>>>>>"))


def _recovery_line(recovery: Recovery) -> tuple[str, ...]:
    figures = recovery.to_dict()
    return (
        recovery.case.title,
        str(figures["seeds"]),
        f"{100 * figures['found']:.0f} %",
        f"{100 * figures['in_interval_95']:.0f} %",
        f"{100 * figures['mean_relative_standard_error']:.2f} %",
        f"{figures['mean_pull']:+.2f}",
        f"{figures['rms_pull']:.2f}",
        f"{figures['largest_pull']:.2f}",
    )


@command.command("noise-profiles")
@click.option("--cameras", type=options.Whole(1), default=400, help="Virtual cameras, with seeds 0, 1, ...")
@options.size_options(512, 768)
@click.option("--no-prnu", is_flag=True, help="Cameras whose pixels are alike: the scale of the demosaicing alone.")
@options.json_option
def noise_profiles(cameras: int, rows: int, cols: int, no_prnu: bool, as_json: bool) -> None:
    """Test the gain that photosite finds in darktable's noise profiles, on profiles of virtual cameras.

    Gain, read noise, nonuniformity, color of the light and demosaicing differ by camera. `covered` is the fraction
    of 95 % intervals that contain the true gain, and `offset covered` that of the variance in the dark. `factor` is the
    profile's a over the true slope. 400 cameras take two minutes.

    Example: photosite reproduce noise-profiles --cameras 50
    """
    from photosite.studies.noise_profiles import coverage_table, profile_camera

    stages = Stages()
    stages.stage(f"profiling {cameras} cameras")
    found = []
    for seed in range(cameras):
        found.append(profile_camera(seed, prnu=not no_prnu, shape=(rows, cols)))
        stages(seed + 1, cameras, "cameras")
    groups = coverage_table(found)
    heading = ("cameras", "number", "covered", "offset covered", "factor", "spread", "median half-width")
    lines = [
        (
            row["group"],
            str(row["cameras"]),
            f"{100 * row['covered']:.1f} %",
            f"{100 * row['offset_covered']:.1f} %",
            f"{row['mean_factor']:.4f}",
            f"{100 * row['relative_spread']:.1f} %",
            f"{100 * row['half_width']:.0f} %",
        )
        for row in groups
    ]
    show(as_json, {"groups": groups}, lambda: table([heading, *lines], "<>>>>>>"))


@command.command("imperfect-stacks")
@click.option("--stacks", type=options.Whole(1), default=1, help="Stacks of each kind, with seeds 0, 1, ...")
@options.json_option
def imperfect_stacks(stacks: int, as_json: bool) -> None:
    """Calibrate stacks of frames that are not clean.

    The results are compared with the truth. A plain NumPy generator makes the stacks: crosstalk, frames filtered in the
    camera, flicker, a color filter array that is not stated, and clean ones. The table lists how many stacks of a kind
    are right, so that each 95 % interval of system gain and PRNU contains the truth or is withheld, in how many the
    diagnostic of this kind is found, and how many withhold them. Below are the diagnostics of the first stack of each
    kind. A stack takes about a second.

    Example: photosite reproduce imperfect-stacks --stacks 20
    """
    from photosite.studies.imperfect_stacks import KINDS
    from photosite.studies.imperfect_stacks import imperfect_stacks as study

    stages, answers = Stages(), []
    say_if_compiling()
    stages.stage(f"calibrating {stacks} stacks of each kind")
    for answer in study(range(stacks)):
        answers.append(answer)
        stages(len(answers), stacks * len(KINDS), "stacks")
    rows: list[tuple[str, ...]] = [("stack", "size", "right", "found", "gain withheld", "PRNU withheld")]
    details = []
    for start in range(0, len(answers), stacks):
        of_kind = answers[start : start + stacks]
        first, kind = of_kind[0], of_kind[0].kind
        counts = (
            sum(answer.right for answer in of_kind),
            sum(answer.found for answer in of_kind),
            sum(isinstance(answer.gain, str) for answer in of_kind),
            sum(isinstance(answer.prnu, str) for answer in of_kind),
        )
        rows.append((kind.name, kind.text, *(f"{count} of {stacks}" for count in counts)))
        details += [
            f"\n{kind.name}, {kind.text}:",
            _answer("system gain, DN/e-", first.gain, kind.gain),
            _answer("PRNU, %", first.prnu, 100.0 * kind.prnu),
            *(f"  {entry.id}: {entry.text}" for entry in first.diagnostics if entry.severity != "withheld"),
        ]
    content = {"stacks": [answer.to_dict() for answer in answers]}
    show(as_json, content, lambda: "\n".join([table(rows, "<<>>>>"), *details]))


@command.command("defective-pixels")
@click.option("--sensors", type=options.Whole(1), default=50, help="Virtual sensors of each kind and fraction.")
@options.workers_options(2)
@options.json_option
def defective_pixels(sensors: int, processes: int, scheduler: str | None, as_json: bool) -> None:
    """Count how often 95 % intervals contain the truth with a few defective pixels.

    Virtual sensors with 0.01, 0.1 and 1 % of hot, stuck, dead and blinking pixels, pixels with another offset, white
    columns and dead clusters are drawn, shot by a camera of plain NumPy and calibrated. The truth is that of the other
    pixels. The table has the fraction of the intervals of eight parameters that contain it, and the largest error in
    standard uncertainties; refused calibrations, withheld parameters, and defective pixels that were not found.

    Example: photosite reproduce defective-pixels --sensors 10
    """
    from photosite.studies.defective_pixels import defect_coverage

    stages = Stages()
    say_if_compiling()
    stages.stage(f"measuring {sensors} virtual sensors of each kind")
    rows = defect_coverage(
        sensors,
        processes=processes,
        scheduler=scheduler,
        progress=lambda done, total: stages(done, total, "sensors"),
    )
    heading = ("defects", "pixels", "intervals", "covered", "largest error", "withheld", "refused", "missed", "others")
    lines = [
        (
            row.kind,
            f"{100 * row.fraction:g} %",
            str(row.intervals),
            f"{100 * row.covered / max(row.intervals, 1):.1f} %",
            f"{row.largest:.1f}",
            str(row.withheld),
            f"{row.refused} of {row.sensors}",
            f"{row.missed} of {row.pixels}",
            str(row.others),
        )
        for row in rows
    ]
    intervals, covered = sum(row.intervals for row in rows), sum(row.covered for row in rows)
    last = f"\n{100 * covered / intervals:.1f} % of all {intervals} intervals contain the truth"
    show(as_json, {"rows": [row.to_dict() for row in rows]}, lambda: table([heading, *lines], "<>>>>>>>>") + last)


@command.command("random-sensors")
@click.option("--sensors", type=options.Whole(1), help="Number of virtual sensors.  [default: 400]")
@click.option("--first", type=options.Whole(0), help="Number of the first sensor.  [default: 0]")
@click.option(
    "--sensor", "numbers", type=options.Whole(0), multiple=True, help="Measure the sensor of this number; repeatable."
)
@click.option("--figure", type=click.Path(dir_okay=False, path_type=Path), help="Figure of the errors, .png or .svg.")
@options.workers_options(2)
@options.json_option
def random_sensors(
    sensors: int | None,
    first: int | None,
    numbers: tuple[int, ...],
    figure: Path | None,
    processes: int,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Count how often 95 % intervals of sensors drawn over the range of practice contain the truth.

    Clean virtual sensors and their measurements are drawn at random, made by plain NumPy, written to files of five
    kinds, and calibrated: gain 0.02 to 20 DN/e-, read noise 0.7 to 40 e-, 8 to 16 bits, PRNU 0.1 to 3 %, wells of 2000
    to 200 000 e-, monochrome and Bayer, 64 x 64 to 400 x 600 pixels, 4 to 40 levels of 2 to 50 frames. The first
    table has the intervals of each parameter, with the errors in standard uncertainties (z); the second one the
    diagnostics, and how many are false alarms. --sensor prints the results of single sensors. A sensor takes 5 s.

    Example: photosite reproduce random-sensors --sensors 40
    """
    from photosite.studies.random_sensors import random_sensors as study

    if numbers and (sensors, first) != (None, None):
        raise click.UsageError("--sensors and --first do not apply to --sensor; omit them")
    stages = Stages()
    say_if_compiling()
    chosen = numbers or range(first or 0, (first or 0) + (sensors or 400))
    stages.stage(f"measuring {len(chosen)} virtual sensors")
    found = study(
        chosen,
        processes=processes,
        scheduler=scheduler,
        progress=lambda done, total: stages(done, total, "sensors"),
    )
    if figure is not None:
        from photosite.files.writing import atomic_path

        with atomic_path(figure) as temporary:
            found.figure().savefig(temporary, dpi=150)
    show(as_json, found.to_dict(), lambda: _random_sensors_text(found, details=bool(numbers)), figure=figure)


def _random_sensors_text(found: RandomSensors, *, details: bool) -> str:
    heading = ("parameter", "intervals", "covered", "rms z", "largest z", "sensor", "withheld", "exact", "wrong")
    rows = [
        (
            row.parameter,
            str(row.intervals),
            f"{100 * row.covered / row.intervals:.1f} %" if row.intervals else "",
            "" if row.sensor is None else f"{row.rms_z:.2f}",
            "" if row.sensor is None else f"{row.largest_z:+.1f}",
            "" if row.sensor is None else str(row.sensor),
            str(row.withheld),
            str(row.exact),
            str(row.wrong),
        )
        for row in found.parameters
    ]
    count, alarms = len(found.results), found.false_alarms
    raised = [
        (id, str(number), str(len(alarms.get(id, ()))), ", ".join(map(str, alarms.get(id, ())[:8])))
        for id, number in found.raised.items()
    ]
    parts = [table([heading, *rows], "<>>>>>>>>")]
    parts.append(f"{100 * found.coverage:.1f} % of all intervals contain the truth")
    parts.append(table([("diagnostic", f"of {count} sensors", "false", "sensors"), *raised], "<>><"))
    refused = [f"sensor {number}: {why}" for number, why in found.refused.items()]
    parts.append(listed(f"refused, of {count} calibrations: {len(refused)}", refused))
    if details:
        parts += [f"sensor {result.sensor.number}: {result.sensor.to_dict()}" for result in found.results]
    return "\n\n".join(parts)


@command.command("detection")
@click.option("--stacks", type=options.Whole(1), default=20, help="Stacks of each size, with seeds 0, 1, ...")
@click.option("--clean", type=options.Whole(1), default=100, help="Clean stacks of each kind.")
@options.json_option
def detection(stacks: int, clean: int, as_json: bool) -> None:
    """Find the smallest effects that diagnostics report.

    The size of an effect on frames is halved until its diagnostic is raised in fewer than 95 of 100 stacks; the last
    step is bisected to 9 %. The diagnostics of clean stacks are false alarms. `photosite explain` and the page of
    diagnostics read the result of --json, which calibration/detection.json keeps. About 2000 stacks of half a second.

    Example: photosite reproduce detection --json
    """
    from photosite.studies.detection import detection_study

    stages = Stages()
    say_if_compiling()
    stages.stage(f"calibrating {stacks} stacks of each size")
    found = detection_study(stacks, clean, progress=lambda kind, amount: stages.stage(f"{kind}: {100 * amount:.3g} %"))
    heading = ("diagnostic", "stack", "smallest size", "found", "smaller tried")
    rows = [
        (id, each["kind"], each["size"], f"{each['found']} of {each['stacks']}", "yes" if each["varied"] else "no")
        for id, entries in found["smallest"].items()
        for each in entries
    ]
    alarms = ", ".join(f"{id} {count}" for id, count in found["alarms"].items()) or "none"
    last = f"\nfalse alarms in {found['clean_stacks']} clean stacks: {alarms}"
    show(as_json, found, lambda: table([heading, *rows], "<<<><") + last)


@command.command("image-quality")
@click.option("--draws", type=options.Whole(1), default=CHARTS, help="Charts of each measurement.")
@click.option("--measurement", "names", multiple=True, metavar="ID", help="Study this measurement only; repeatable.")
@click.option(
    "--table",
    "table_file",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Table in Markdown; other rows of the file stay.",
)
@options.workers_options(2)
@options.json_option
def image_quality(
    draws: int, names: tuple[str, ...], table_file: Path | None, processes: int, scheduler: str | None, as_json: bool
) -> None:
    """Count how often 95 % intervals of image quality contain the truth.

    Plain NumPy draws charts with noise, blur, uneven light, tilt, distortion and mosaics, where these apply to a
    measurement (`photosite measure`), and hides the truth, which is known in closed form. For every quantity the table
    has the charts with an interval, the fraction of intervals that contain the truth (covered), mean and root mean
    square of error over uncertainty (bias and width; 0 and 1 are correct), and the largest. With 200 draws the
    standard error of a coverage of 95 % is 1.5 %. A chart takes 0.01 to 2 s on one core.

    Example: photosite reproduce image-quality --draws 20 --measurement edge-sfr
    """
    from photosite.files.writing import atomic_path
    from photosite.studies.image_quality import image_quality_study

    stages = Stages()
    stages.stage(f"measuring {draws} charts of each measurement")
    study = image_quality_study(
        names,
        charts=draws,
        processes=processes,
        scheduler=scheduler,
        progress=lambda done, total: stages(done, total, "charts"),
    )
    if table_file is not None:
        before = table_file.read_text(encoding="utf-8") if table_file.exists() else ""
        with atomic_path(table_file) as temporary:
            temporary.write_text(study.markdown(before), encoding="utf-8")
    show(as_json, study.to_dict(), lambda: _image_quality_text(study))


def _image_quality_text(study: ImageQualityStudy) -> str:
    from photosite.studies.measurement_study import measurement_studies

    heading = ("quantity", "charts", "intervals", "covered", "bias", "width", "largest", "withheld")
    parts = []
    for name, seconds in study.seconds.items():
        lines = [
            (
                row.quantity,
                str(row.charts),
                str(row.intervals),
                f"{100 * row.covered:.1f} %",
                f"{row.bias:+.2f}",
                f"{row.width:.2f}",
                f"{row.largest:+.1f}",
                str(row.withheld),
            )
            for row in study.of(name)
        ]
        covered = f"{100 * study.pooled(name):.1f} % covered, " if lines else ""
        parts.append(f"{name}: {covered}{seconds:.2g} s a chart ({measurement_studies()[name].varied})")
        parts.append(table([heading, *lines], "<>>>>>>>"))
        if refusals := study.refused.get(name):
            parts.append(listed("refused:", (f"{count} charts: {why}" for why, count in refusals.items())))
    return "\n".join(parts)


def _answer(name: str, given: tuple[float, float] | str, truth: float) -> str:
    """Return a line with an interval of 95 % and the truth, or that it is withheld."""
    if isinstance(given, str):
        return f"  {name}: withheld"
    return f"  {name}: {given[0]:.4g} to {given[1]:.4g} (true {truth:.4g})"


@command.command("coverage")
@click.option("--sensors", type=options.Whole(1), help=f"Virtual sensors per condition.  [default: {SENSORS}]")
@click.option(
    "--condition",
    "conditions",
    cls=_ConditionOption,
    multiple=True,
    metavar="NAME",
    help="Study this condition only; repeatable.",
)
@click.option("--quick", is_flag=True, help=f"Use {QUICK_SENSORS} sensors, which detect large errors only.")
@click.option(
    "--table", "table_file", type=click.Path(dir_okay=False, path_type=Path), help="Tables in Markdown, as well."
)
@options.workers_options(2)
@options.json_option
def coverage(
    sensors: int | None,
    conditions: tuple[str, ...],
    quick: bool,
    table_file: Path | None,
    processes: int,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Count how often 95 % intervals contain the truth.

    Virtual sensors are drawn, shot and calibrated under several conditions: bright and dim light, few frames, clipped
    dark frames, monochrome and Bayer, 8 to 16 bits, and frames that are not clean (bends, crosstalk, flicker, row
    noise, hot pixels, shading, a wrong level). For every parameter the table lists the fraction of
    intervals that contain the truth (covered), the mean error over the mean standard uncertainty (bias), and the root
    mean square of error over uncertainty (width; 1 is correct). With 500 sensors the standard error of a coverage of
    95 % is 1 %. A sensor takes 0.35 to 1.2 s on one core.

    A parameter is flagged where a deviation is significant: a coverage, or a mean error beyond a tenth of the
    uncertainty, that correct intervals show in fewer than one study in 1000. Failed calibrations are counted, and are
    not in the table. Effects that calibrations report, such as a response curve, are counted, too: false alarms where
    the condition has no such effect.

    Example: photosite reproduce coverage --quick --condition few-mono-12
    """
    from photosite.studies.conditions import condition
    from photosite.studies.coverage import coverage_study

    if quick and sensors is not None:
        raise click.UsageError("give one of --quick and --sensors")
    for name in conditions:
        condition(name)
    stages = Stages()
    say_if_compiling()
    count = sensors or (QUICK_SENSORS if quick else SENSORS)
    stages.stage(f"measuring {count} virtual sensors per condition")
    study = coverage_study(
        conditions,
        sensors=count,
        processes=processes,
        scheduler=scheduler,
        progress=lambda done, total: stages(done, total, "sensors"),
    )
    if table_file is not None:
        from photosite.files.writing import atomic_path

        with atomic_path(table_file) as temporary:
            temporary.write_text(study.markdown(), encoding="utf-8")
    show(as_json, study.to_dict(), lambda: _text(study))


def _text(study: CoverageStudy) -> str:
    from photosite.studies.conditions import CONDITIONS
    from photosite.studies.coverage import FALSE_ALARM

    lines = []
    for name in study.conditions:
        lines.append(f"\n{name}: {CONDITIONS[name].summary}")
        refusals = study.refused.get(name, ())
        if refusals:
            count = sum(entry.sensors for entry in refusals)
            failed = f"{count} of {study.sensors} calibrations failed with an error and are not in the table:"
            lines.append(listed(failed, (f"{entry.sensors}, for example: {entry.example}" for entry in refusals)))
        if warnings := study.warnings.get(name, ()):
            lines.append(listed("warnings:", (f"{entry.sensors}, for example: {entry.example}" for entry in warnings)))
        if effects := study.effects.get(name, {}):
            lines.append("effects reported: " + ", ".join(f"{effect} {count}" for effect, count in effects.items()))
        rows = [row for row in study.rows if row.condition == name]
        if rows:
            heading = ("parameter", "sensors", "covered", "bias", "width", "")
            lines.append(table([heading, *map(_line, rows)], "<>>>><"))
    flagged = sum(not row.passes for row in study.rows)
    lines.append(
        f"\n{flagged} of {len(study.rows)} lines are flagged. Each test flags correct intervals in fewer than 1 of "
        f"{1 / FALSE_ALARM:.0f} studies of {study.sensors} sensors."
    )
    return "\n".join(lines)


def _line(row: Coverage) -> tuple[str, ...]:
    remarks = list(row.remarks)
    if row.exact and not row.wrong:
        remarks.append(f"{row.exact} exact")
    if row.exact == row.estimated:
        return row.parameter, str(row.estimated), "", "", "", "; ".join(remarks)
    numbers = (f"{100 * row.covered:.1f} %", f"{row.bias:+.2f}", f"{row.width:.2f}")
    return row.parameter, str(row.estimated), *numbers, "; ".join(remarks)
