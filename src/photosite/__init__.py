"""photosite measures image sensors and simulates the cameras around them.

Dark frames and flat fields give a sensor file. A spectral scene, a lens and a sensor file give simulated raw frames.
Measured and simulated frames are compared. The stub beside this file lists the public names; each is imported on first
use.
"""

import lazy_loader as lazy

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
