"""Reasons why figures have no value, as kinds of diagnostics."""

from __future__ import annotations

from photosite.values.diagnostic import DiagnosticKind

DARK_CURRENT = ("dark_current_*", "dark_voltage_*", "dcnu_percent")
RESPONSE = ("responsivity_*", "quantum_efficiency_*")
"""Parameters that diagnostics often concern together: of the dark current, and of the response to known light."""


def _withheld(id: str, seen: str, remedy: str, *parameters: str, effect: str = "") -> DiagnosticKind:
    return DiagnosticKind(id, "withheld", seen, effect or "The figures that need it have no value.", remedy, parameters)


NO_FLAT_FIELDS = DiagnosticKind(
    "no-flat-fields",
    "warning",
    "There are no flat fields.",
    "Gain, electrons, PRNU and saturation are not known.",
    "Take flat fields at two levels or more.",
    ("system_gain_dn_per_e", "*_e", "*_e_per_s", "prnu*", "saturation_*", "*_photons"),
    false_alarms="none: frames are counted",
)
UNKNOWN_DARK_NOISE = DiagnosticKind(
    "unknown-dark-noise",
    "warning",
    "There are no dark frames, or one of each exposure time.",
    "Read noise, DSNU and what follows from them are not known. The system gain comes from differences between flat "
    "fields, with a larger uncertainty.",
    "Take two dark frames or more at the shortest exposure time.",
    ("read_noise_*", "dsnu*", "temporal_dark_noise_e", "system_gain_dn_per_e", "sensitivity_*", "dynamic_range_db"),
    false_alarms="none: frames are counted",
)
ONE_DARK_EXPOSURE = DiagnosticKind(
    "one-dark-exposure",
    "warning",
    "All dark frames have one exposure time.",
    "The dark current is not known. Black level, read noise and DSNU are those at this time: they contain its dark "
    "current if it is long.",
    "Take dark frames at a second, much shorter or longer exposure time.",
    ("read_noise_*", "dsnu_*", "black_level_dn", *DARK_CURRENT),
    "exposure time, s",
    "none: exposure times are compared",
)
UNKNOWN_DARK_CURRENT = DiagnosticKind(
    "unknown-dark-current",
    "warning",
    "The dark frames have one exposure time, and the flat fields have others.",
    "The dark current is not known; the uncertainties of responsivity, quantum efficiency and PRNU include it, or they "
    "are withheld.",
    "Take dark frames at a second exposure time.",
    (*DARK_CURRENT, *RESPONSE, "prnu*"),
    "largest dark current that the flat fields allow, DN/s",
    "none: exposure times are compared",
)
NO_SATURATION = DiagnosticKind(
    "no-saturation",
    "warning",
    "No flat field reached saturation, or none in all of its pixels.",
    "All unclipped levels were taken as linear; saturation, dynamic range and maximum SNR are not known.",
    "Take brighter flat fields, up to where they stop rising.",
    ("saturation_*", "snr_max_db", "dynamic_range_db", "linearity_*", "prnu1288*"),
)
FEW_LEVELS = DiagnosticKind(
    "few-light-levels",
    "warning",
    "Fewer light levels lie in the linear range than a figure needs.",
    "The linearity could not be checked; the gain of one level is too low if that level is close to saturation.",
    "Take flat fields at shorter exposure times, or at more levels.",
    ("system_gain_dn_per_e", "linearity_*", "prnu*"),
    "number of levels",
)
SINGLE_FLATS = DiagnosticKind(
    "single-flat-fields",
    "warning",
    "Light levels have one frame.",
    "They show no temporal noise, and are not used for the system gain.",
    "Take two frames or more at each level.",
    ("system_gain_dn_per_e",),
    "number of levels",
    "none: frames are counted",
)
IMPLAUSIBLE = DiagnosticKind(
    "implausible",
    "warning",
    "A dark current is negative, or a quantum efficiency above 100 %, beyond chance.",
    "The value cannot be true, and is withheld with the likely cause.",
    "Correct exposure times or photons in the protocol; switch the camera's black level clamp off.",
    (*DARK_CURRENT, *RESPONSE, "*_photons", "system_gain_dn_per_e"),
    false_alarms="below 1 of 10 000 sets",
)
HIDDEN_NOISE = DiagnosticKind(
    "noise-hidden-by-quantization",
    "warning",
    "The temporal variance of the dark frames is below 0.24 DN² (EMVA 1288).",
    "Quantization hides the read noise: only its upper limit is known. Rounding errors were added to the uncertainties "
    "of DSNU, black level, dark current and DCNU. The system gain comes from the flat fields, with a free constant; "
    "the standard's, in the block `emva1288`, does not. With the largest variance that may be hidden, the sensitivity "
    "threshold is an upper limit, and the dynamic range a lower one.",
    "Use a higher gain setting.",
    (
        *("system_gain_dn_per_e", "read_noise_*", "temporal_dark_noise_e", "row_noise_*", "column_noise_*"),
        *("dsnu*", "black_level_dn", "sensitivity_threshold_photons", "dynamic_range_db", *DARK_CURRENT),
    ),
    "dark temporal variance, DN²",
    "none: it is the standard's rule",
)
NO_MAPS = DiagnosticKind(
    "no-maps",
    "warning",
    "The maps of the chip were not requested, or could not be measured.",
    "There are no maps, no list of defects and no distribution of noise and dark current over the pixels.",
    "Calibrate with maps (--maps). Raise the camera's black level so that dark frames do not clip at 0.",
)
NO_LINE_NOISE = _withheld(
    "no-line-noise",
    "There are no repeated dark frames of two lines or more without clipping at 0.",
    "Take two dark frames or more, at a higher black level.",
    "row_noise_*",
    "column_noise_*",
)
UNMEASURED_LIGHT = _withheld(
    "unmeasured-light",
    "Flat fields of one exposure time received different light, and the amounts are not stated. The levels are those "
    "of the listing; a bend of the response shows in the temporal variances only.",
    "State photons_per_pixel in a protocol, or vary the exposure time in constant light.",
    "linearity_*",
)
UNKNOWN_PHOTONS = _withheld(
    "unknown-photons",
    "The photons per pixel are not known.",
    "Give them in a descriptor or a protocol.",
    *RESPONSE,
    "*_photons",
)
NO_LINEAR_LEVEL = _withheld(
    "no-linear-level",
    "No light level lies in the linear range.",
    "Take flat fields between the dark level and 70 % of saturation.",
    "system_gain_dn_per_e",
    *RESPONSE,
)
NO_HALF_SATURATION = _withheld(
    "no-half-saturation",
    "No light level with two frames lies between 30 and 70 % of saturation.",
    "Take a stack at 50 % of saturation, better of 50 frames.",
    "prnu1288*",
)
UNDEFINED_LINEARITY = _withheld(
    "undefined-linearity",
    "The line of least relative squares through the response falls to zero within its range.",
    "Check the stated light.",
    "linearity_*",
)
NO_SIGNAL_TO_NOISE = _withheld(
    "no-signal-to-noise",
    "No light level shows signal and noise, or none a signal-to-noise ratio of 1.",
    "Take brighter flat fields with two frames or more.",
)
NO_COUPLING = _withheld(
    "no-coupling",
    "The covariances of neighboring pixels cannot be measured.",
    "Take two dark frames, and two flat fields in the linear range, of larger frames.",
    "interpixel_coupling_percent",
)
NO_SENSOR_FILE = _withheld(
    "no-sensor-file",
    "Voltage swing and analog gain, or the pixel size, are not known.",
    "Give a sensor file of this sensor (--sensor).",
    "*_mv",
    "*_mv_per_s",
    "conversion_gain_*",
)
NO_DARK_CURRENT = _withheld(
    "no-dark-current",
    "The dark current is not distinguishable from zero.",
    "Take longer dark exposures.",
    "dcnu_percent",
)
NEGATIVE_DARK_VARIANCE = _withheld(
    "negative-dark-variance",
    "The dark temporal variance is negative at exposure zero.",
    "Take shorter dark frames.",
    "sensitivity_threshold_photons",
    "dynamic_range_db",
)
SMALL_FRAMES = _withheld(
    "small-frames",
    "The color planes have too few rows or columns for the high-pass filter of EMVA 1288.",
    "Use larger frames.",
    "*1288*",
)
NO_RATIO = _withheld(
    "no-capture-ratio",
    "Two captures have too few common levels in their linear ranges.",
    "Add light levels at which both captures are linear.",
)
HIDDEN_CAPTURE = _withheld(
    "hidden-capture",
    "The combined frames do not show this figure of a capture.",
    "Calibrate the frames of the capture itself.",
)
WRONG_PROPORTION = _withheld(
    "wrong-proportion",
    "The signal is not in proportion to the stated light, by a factor of two or more.",
    "Check photons and exposure times in the protocol, the lamp and the shutter.",
    "system_gain_dn_per_e",
    "*_e",
)
NO_PHOTON_TRANSFER = _withheld(
    "no-photon-transfer",
    "The temporal variance does not rise with the signal.",
    "Take brighter flat fields, or more frames.",
    "system_gain_dn_per_e",
    "*_e",
)
CLIPPED_TOO_FAR = DiagnosticKind(
    "darks-clipped-too-far",
    "refused",
    "So many numbers of the dark frames are 0 that the rest does not tell level and noise.",
    "There is no result.",
    "Raise the camera's black level (pedestal), and take the dark frames again.",
    ("*",),
)
UNSOLVED_CLIPPING = DiagnosticKind(
    "clipped-darks-unsolved",
    "refused",
    "Numbers of dark frames are 0, and the numerical search for level and noise of the rest did not converge.",
    "There is no result. The frames may be good.",
    "Leave out the dark frames of this exposure time; a higher black level (pedestal) of the camera avoids the search.",
    ("*",),
)
FEW_SETTINGS = DiagnosticKind(
    "few-gain-settings",
    "warning",
    "The series has too few gain settings for the search for a conversion-gain switch, or fewer than two with a gain.",
    "There is no search, or no result of the series.",
    "Take dark frames and flat fields at more settings; state the gain setting of all frames.",
    size="number of settings",
)
SETTING_WITHOUT_GAIN = DiagnosticKind(
    "setting-without-gain",
    "warning",
    "A gain setting has no system gain.",
    "It is not used in the joint analysis, and is not in the sensor file.",
    "See the diagnostics of this setting.",
)
IRREGULAR_GAIN = DiagnosticKind(
    "irregular-gain",
    "warning",
    "The system gain of a setting deviates from the trend of the others by a tenth or more.",
    "The setting of 1 DN per electron and the noise behind the amplifier are less certain.",
    "Check the stated setting of these frames.",
    size="relative deviation",
)
SEVERAL_CAPTURES = DiagnosticKind(
    "several-captures",
    "refused",
    "The temporal variance of the flat fields steps: the numbers combine several captures, or are companded.",
    "One system gain does not describe them.",
    "State the captures in the sensor file, undo the companding (--linearize), or calibrate each capture.",
    ("*",),
)
HIDDEN_LEVELS = DiagnosticKind(
    "levels-hidden-by-rounding",
    "warning",
    "Levels of combined frames have less noise than steps of the numbers.",
    "They were left out: rounding or clipping hides their noise.",
    "Take brighter flat fields, or frames of more bits.",
    size="number of levels",
)
NO_KNEE = DiagnosticKind(
    "no-knee",
    "warning",
    "The photon transfer of combined frames has no knee.",
    "The frames show one capture, or captures that read one charge, with their read noise hidden.",
    "Take more levels of light around the change of captures.",
)
COMPANDED_FRAMES = DiagnosticKind(
    "companded-frames",
    "refused",
    "The temporal variance falls while the signal rises.",
    "The numbers are companded; one gain does not describe them.",
    "Give the companding table.",
    ("*",),
)
FEW_COMBINED_LEVELS = DiagnosticKind(
    "few-combined-levels",
    "refused",
    "There are no repeated dark frames, or repeated flat fields at fewer than three levels.",
    "Combined frames cannot be split into captures.",
    "Take two frames or more at more levels.",
    ("*",),
)
NO_DOUBLING_TEMPERATURE = DiagnosticKind(
    "no-doubling-temperature",
    "warning",
    "The dark currents do not give a doubling temperature, or only two temperatures were measured.",
    "There is no doubling temperature, or none that the data check.",
    "Take dark frames at a third temperature, at longer exposure times.",
)
EXCESS_NOISE = DiagnosticKind(
    "unexpected-excess-noise",
    "warning",
    "The excess noise factor of the multiplication register is not that of theory.",
    "Gain and read noise of the register are doubtful.",
    "Repeat both measurements in constant light, below saturation of the register.",
    size="excess noise factor",
    false_alarms="1 of 1000 measurements",
)
EM_GAIN_UNKNOWN = DiagnosticKind(
    "no-em-gain",
    "refused",
    "The two calibrations do not give a multiplication gain.",
    "There is no result.",
    "Take both measurements with flat fields in the same light; the first one without multiplication.",
    ("*",),
)
BAND_NOT_USED = DiagnosticKind(
    "band-not-used",
    "warning",
    "A band of light, or patches of a chart, could not be used in a channel.",
    "The quantum efficiency there comes from the others, or is missing.",
    "Change the exposure time: saturated and dark bands or patches are not used.",
)
VARYING_LIGHT = DiagnosticKind(
    "varying-light",
    "warning",
    "The light of a spectral measurement varies between frames.",
    "The uncertainties include this.",
    "Let the lamp warm up.",
    size="relative standard deviation",
)
UNUSABLE_SPECTRAL_FRAMES = DiagnosticKind(
    "unusable-spectral-frames",
    "refused",
    "Too few bands, patches or pixels can be used for a quantum efficiency, or it would be impossible.",
    "There is no result.",
    "Change exposure times, region or the stated light.",
    ("*",),
)
EFFECT_NOT_SEEN = _withheld(
    "effect-not-seen",
    "The frames show no such effect beyond chance.",
    "Nothing, or take more frames to look for a smaller one.",
    effect="The effect has no size.",
)
EFFECT_NOT_MEASURED = _withheld(
    "effect-not-measured",
    "These frames cannot show the effect.",
    "Take the frames that the reason names.",
    effect="The effect has no size.",
)
