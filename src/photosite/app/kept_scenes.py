"""Scenes that a worker process keeps, because a chart of the camera's size takes longer than a picture."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from photosite.app.state import PreparedState
from photosite.scene.scene import Scene
from photosite.scene.scene_request import SceneRequest

KEPT_SCENES = 3
_scenes: OrderedDict[tuple[Any, ...], Scene] = OrderedDict()


def add_kept(kept: OrderedDict[Any, Any], key: Any, value: Any, most: int = 16) -> None:
    """Add a value to those that are kept, and drop the oldest beyond `most`.

    Keys have the `id` of a sensor or a scene's weights. The value holds this object, so that no other one gets its id.
    """
    while len(kept) >= most:
        kept.popitem(last=False)
    kept[key] = value


def scene_of(found: PreparedState) -> Scene:
    """Return the scene of a state, made once."""
    return _made(found.request)


def unit_scene(found: PreparedState) -> tuple[Scene, float]:
    """Return the scene at 1 cd/m2 where the state gives its luminance, and the factor of its light to that luminance.

    The image is linear in the luminance, so that a change of it needs neither a scene nor an image.
    """
    luminance_cd_m2 = found.request.options.get("mean_luminance_cd_m2")
    if luminance_cd_m2 is None:
        return scene_of(found), 1.0
    options = {**found.request.options, "mean_luminance_cd_m2": 1.0}
    return _made(replace(found.request, options=options)), float(luminance_cd_m2)


def _made(request: SceneRequest) -> Scene:
    changed = Path(request.source).stat().st_mtime_ns if request.is_file else 0
    key = (request.source, changed, tuple(sorted((name, str(value)) for name, value in request.options.items())))
    if key not in _scenes:
        scene = request.scene()
        for other in _scenes.values():  # a change of the light leaves the weights, so that their spectra are kept
            if np.array_equal(scene.weights, other.weights):
                scene = replace(scene, weights=other.weights)
                break
        add_kept(_scenes, key, scene, KEPT_SCENES)
    _scenes.move_to_end(key)
    return _scenes[key]
