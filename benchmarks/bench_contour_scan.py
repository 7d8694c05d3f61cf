"""Contour scan: N hypotheses, 24 normals of 21 samples each, on edge maps of 240 x 180 that change with every
call.

The same hypotheses again and again would train the branch predictor and flatter a scan that stops at the
first edge.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
from _timing import interleaved, machine, milliseconds, print_table

from pfviz import kernels

HEIGHT, WIDTH, POINTS, REACH = 180, 240, 24, 10
SIZES = (100, 400, 2000)
FRAMES = 40


def plain(edges, transforms, points, normals, cost):
    """All samples of all normals at once."""
    reach = len(cost) - 2
    height, width = edges.shape
    matrices, shifts = transforms[:, :, :2], transforms[:, :, 2]
    centres = points @ matrices.transpose(0, 2, 1) + shifts[:, None]
    across = normals @ np.linalg.inv(matrices)
    across /= np.linalg.norm(across, axis=2, keepdims=True)
    steps = np.arange(-reach, reach + 1)
    samples = np.floor(centres[:, :, None] + steps[:, None] * across[:, :, None] + 0.5).astype(np.int64)
    x, y = samples[..., 0], samples[..., 1]
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    hit = inside & (edges[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)] > 0)
    return cost[np.where(hit, np.abs(steps), reach + 1).min(axis=2)].sum(axis=1)


CONTESTANTS = {
    "plain NumPy": plain,
    "pfviz NumPy twin": kernels.scan_contours_numpy,
    "pfviz compiled": kernels.scan_contours,
}


def frame(rng: np.random.Generator) -> np.ndarray:
    """Canny edges of a noisy picture of ellipses."""
    image = np.full((HEIGHT, WIDTH), 110.0, dtype=np.float32)
    for _ in range(12):
        centre, axes = rng.integers(0, [WIDTH, HEIGHT]), rng.integers(8, 45, 2)
        grey, angle = rng.uniform(0.0, 255.0), rng.uniform(0.0, 180.0)
        cv2.ellipse(image, centre.tolist(), axes.tolist(), angle, 0.0, 360.0, grey, -1)
    image = cv2.GaussianBlur(image + rng.normal(0.0, 6.0, image.shape).astype(np.float32), (0, 0), 1.2)
    return cv2.Canny(np.clip(image, 0, 255).astype(np.uint8), 40, 100)


def hypotheses(rng: np.random.Generator, n: int) -> np.ndarray:
    angle, scale = rng.normal(0.0, 0.2, n), np.exp(rng.normal(0.0, 0.1, n))
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    x, y = rng.normal(WIDTH / 2, 15.0, n), rng.normal(HEIGHT / 2, 12.0, n)
    return np.stack([np.stack([c, -s, x], axis=1), np.stack([s, c, y], axis=1)], axis=1)


def main() -> None:
    kernels.warm_up()
    print(machine())
    around = np.linspace(0.0, 2.0 * np.pi, POINTS, endpoint=False)
    points = np.stack([20.0 * np.cos(around), 30.0 * np.sin(around)], axis=1)
    normals = points / np.array([20.0, 30.0]) ** 2
    cost = -np.append(np.arange(REACH + 1.0) ** 2 / 18.0, 6.0)
    medians = {}
    for n in SIZES:
        rng = np.random.default_rng(n)
        frames = [(frame(rng), hypotheses(rng, n)) for _ in range(FRAMES)]
        exact = plain(*frames[0], points, normals, cost)
        for scan in CONTESTANTS.values():
            np.testing.assert_allclose(scan(*frames[0], points, normals, cost), exact, atol=1e-9)
        runs = {name: partial(scan, points=points, normals=normals, cost=cost) for name, scan in CONTESTANTS.items()}
        medians[n] = interleaved(runs, frames, rounds=120)
    rows = [
        [name]
        + [f"{milliseconds(medians[n][name])} ({medians[n]['plain NumPy'] / medians[n][name]:.1f}x)" for n in SIZES]
        for name in CONTESTANTS
    ]
    columns = ["", *(f"N = {n}" for n in SIZES)]
    print_table("Contour scan: median time, padding included (times as fast as plain NumPy)", columns, rows)


if __name__ == "__main__":
    main()
