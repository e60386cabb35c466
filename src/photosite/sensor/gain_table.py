"""Changes of a sensor's gain settings, and of its values at one of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from photosite.sensor.model import Sensor

GAIN_TABLE = ("gain_setting", "gain_settings", "gain_setting_is_iso")
"""Fields of a sensor that state its gain settings."""


def changed_at_setting(sensor: Sensor, setting: float | None, changes: Mapping[str, Any]) -> Sensor:
    """Return a sensor at a gain setting, with changed fields as for `Sensor.with_`.

    Changes of `GAIN_TABLE` come first, so that `setting` can be one of the changed settings. The other changes replace
    the values at the setting.

    Raises
    ------
    InputError
        If there is no such field or setting, or a value is invalid.

    Examples
    --------
    >>> import photosite as ps
    >>> changes = {"gain_setting": 100, "gain_settings": [{"setting": 400, "analog_gain": 4.4}], "read_noise_e": 9}
    >>> fast = changed_at_setting(ps.load_sensor("nikon-d200"), 400, changes)
    >>> fast.gain_setting, fast.readout.analog_gain.value, fast.all_gain_settings
    (400.0, 4.4, (100.0, 400.0))
    """
    table = {name: value for name, value in changes.items() if name in GAIN_TABLE}
    sensor = sensor.with_(**table) if table else sensor
    sensor = sensor if setting is None else sensor.at_gain_setting(setting)
    values = {name: value for name, value in changes.items() if name not in GAIN_TABLE}
    return sensor.with_(**values) if values else sensor
