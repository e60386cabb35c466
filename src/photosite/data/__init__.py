"""Training data: pairs of clean and noisy raw frames as map-style datasets."""

from photosite.data.collate import collate as collate
from photosite.data.collate import pack as pack
from photosite.data.dataset import PairDataset as PairDataset
from photosite.data.light import Electrons as Electrons
from photosite.data.light import RawFrames as RawFrames
from photosite.data.pair import Pair as Pair
from photosite.data.scenes import Scenes as Scenes
from photosite.data.shards import ShardDataset as ShardDataset
from photosite.data.shards import write_shards as write_shards
from photosite.sensor.own_noise import OwnNoise as OwnNoise

__all__ = [
    "Electrons",
    "OwnNoise",
    "Pair",
    "PairDataset",
    "RawFrames",
    "Scenes",
    "ShardDataset",
    "collate",
    "pack",
    "write_shards",
]
