"""Scenes of several planes, and scenes that change with time: public names of `photosite.scenes`."""

from photosite.scene.dynamic_scene import DynamicScene as DynamicScene
from photosite.scene.flicker import PulseFlicker as PulseFlicker
from photosite.scene.flicker import SineFlicker as SineFlicker
from photosite.scene.flicker import TableFlicker as TableFlicker
from photosite.scene.motion import Motion as Motion
from photosite.scene.planes import Plane as Plane
from photosite.scene.planes import Planes as Planes

__all__ = ["DynamicScene", "Motion", "Plane", "Planes", "PulseFlicker", "SineFlicker", "TableFlicker"]
__dir__ = __all__.copy
