"""Training data: pairs of clean and noisy raw frames as map-style datasets."""

from photosite.data.dataset import PairDataset as PairDataset
from photosite.data.light import Electrons as Electrons
from photosite.data.light import RawFrames as RawFrames
from photosite.data.pair import Pair as Pair
from photosite.data.scenes import Scenes as Scenes
from photosite.sensor.own_noise import OwnNoise as OwnNoise

__all__ = ["Electrons", "OwnNoise", "Pair", "PairDataset", "RawFrames", "Scenes"]
