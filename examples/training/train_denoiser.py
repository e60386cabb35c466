"""
A denoiser trained for a minute
===============================

Trains the same small network on three kinds of pairs: with the calibrated noise of a sensor, with Gaussian noise of the
same mean power, and with Gaussian noise of the power of each frame. Each works in units of the noise that its model
expects of a frame. All denoise held-out virtual raw frames: another picture, on other chips. Needs torch
(`pip install '.[ml]'`); run it with `python examples/training/train_denoiser.py`.
"""

from __future__ import annotations

import time

import numpy as np
import torch
from matplotlib.cbook import get_sample_data
from torch import nn

import photosite as ps

LENS = ps.DiffractionLimited(f_number=2, focal_length_mm=4)
BATCH, WIDTH = 8, 16


def pairs(scenes: list, serials: range, crops: int, seed: int) -> ps.training.PairDataset:
    """Return patches of scenes, on chips of several serial numbers."""
    light = {"illuminants": ["D65", "A"], "white_luminance_cd_m2": 200}
    source = ps.training.Scenes(scenes, LENS, samples_per_pixel=(0.25, 1.0), **light)
    sensor = ps.load_sensor("google-pixel-4a").with_(rows=512, cols=512)
    sensor = sensor.with_(row_noise_mv=0.5 * sensor.noise.read_noise_mv.value)
    chips = [sensor.with_(serial=str(number)) for number in serials]
    return ps.training.PairDataset(source, chips, crop=(64, 64), crops=crops, exposure_s=(1 / 1000, 1 / 15), seed=seed)


def tensors(dataset: ps.training.PairDataset) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return clean and noisy frames (pairs, 4, rows / 2, cols / 2), black 0, and their noise by the sensor's model."""
    batch = ps.training.collate(list(dataset), "torch", packed=True)
    names = "black_level_dn", "noise_slope_dn", "noise_offset_dn2"
    black, slope, offset = (batch.metadata[name].float()[:, None, None, None] for name in names)
    noisy = batch.noisy.float() - black
    sigma = (slope * noisy.mean((1, 2, 3), keepdim=True).clamp(min=0) + offset).sqrt()
    return batch.clean - black, noisy, sigma


def denoised(model: nn.Module, noisy: torch.Tensor, sigma: torch.Tensor) -> torch.Tensor:
    """Return frames minus the noise that a network finds in them; it sees their deviation from the mean over sigma."""
    mean = noisy.mean((2, 3), keepdim=True)
    return noisy - sigma * model((noisy - mean) / sigma)


def trained(clean: torch.Tensor, noisy: torch.Tensor, sigma: torch.Tensor, steps: int, seed: int) -> nn.Module:
    """Return a network of four convolutions, trained on pairs with the errors in units of sigma."""
    torch.manual_seed(seed)
    inner = [layer for _ in range(2) for layer in (nn.Conv2d(WIDTH, WIDTH, 3, padding=1), nn.ReLU())]
    last = nn.Conv2d(WIDTH, 4, 3, padding=1)
    nn.init.zeros_(last.weight)
    model = nn.Sequential(nn.Conv2d(4, WIDTH, 3, padding=1), nn.ReLU(), *inner, last)
    optimizer, order = torch.optim.Adam(model.parameters(), 3e-3), np.random.default_rng(seed)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(steps):
        chosen = torch.from_numpy(order.integers(0, len(clean), BATCH))
        error = denoised(model, noisy[chosen], sigma[chosen]) - clean[chosen]
        optimizer.zero_grad()
        (error / sigma[chosen]).abs().mean().backward()
        optimizer.step()
        schedule.step()
    return model


def main(steps: int = 3000, patches: int = 48, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Train the networks; return the noise power left of held-out frames in dB: mean over frames, and in total."""
    leaves = [ps.charts.dead_leaves("D65", contrast=50, rows=256, cols=256, seed=number) for number in range(8)]
    clean, noisy, sigma = tensors(pairs(leaves, range(8), patches, seed=1 + 2 * seed))
    photograph = str(get_sample_data("grace_hopper.jpg", asfileobj=False))
    clean_2, noisy_2, sigma_2 = tensors(pairs([photograph], range(100, 108), 128, seed=2 + 2 * seed))
    power = (noisy_2 - clean_2).square().mean((1, 2, 3))
    own = (noisy - clean).square().mean((1, 2, 3), keepdim=True).sqrt()
    one = own.square().mean().sqrt().expand_as(own)
    deviates = torch.randn(clean.shape, generator=torch.Generator().manual_seed(seed))
    models = {
        "calibrated": (noisy, sigma, sigma_2),
        "gaussian": (clean + one * deviates, one, one[:1].expand_as(sigma_2)),
        "gaussian of each frame": (clean + own * deviates, sigma, sigma_2),
    }
    found = {}
    for name, (seen, unit, unit_2) in models.items():
        start = time.perf_counter()
        model = trained(clean, seen, unit, steps, seed)
        with torch.no_grad():
            left = (denoised(model, noisy_2, unit_2) - clean_2).square().mean((1, 2, 3))
        frames, total = 10 * (left / power).log10().mean(), 10 * (left.sum() / power.sum()).log10()
        found[name] = float(frames), float(total)
        seconds = time.perf_counter() - start
        print(f"{name}: {frames:.2f} dB mean over frames, {total:.2f} dB in total, {seconds:.0f} s", flush=True)
    return found


if __name__ == "__main__":
    main()
