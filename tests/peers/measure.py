"""Numbers that compare two sets of ends of the same gaits."""

import numpy as np


def ranks(values):
    """Ranks from 0; equal values share their mean rank."""
    _, index, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts) - 1
    return (last - (counts - 1) / 2)[index]


def spearman(a, b):
    a, b = ranks(a), ranks(b)
    a, b = a - a.mean(), b - b.mean()
    scale = np.sqrt((a @ a) * (b @ b))
    return float(a @ b / scale) if scale > 0 else float("nan")


def both_sound(a, b):
    return np.isfinite(a.pose).all(axis=1) & np.isfinite(b.pose).all(axis=1)


def rank_agreement(a, b, resamples=1000):
    """Spearman's correlation of planar distance, with a bootstrap interval of 95 %."""
    sound = both_sound(a, b)
    a, b = a.distance[sound], b.distance[sound]
    rng = np.random.default_rng(0)
    drawn = [spearman(a[i], b[i]) for i in rng.integers(0, len(a), (resamples, len(a)))]
    low, high = np.nanpercentile(drawn, [2.5, 97.5])
    return {"spearman": spearman(a, b), "low": float(low), "high": float(high), "broken": int((~sound).sum())}


def pose_errors(a, b):
    """Median and 95th percentile of the differences of place (mu) and heading (rad)."""
    sound = both_sound(a, b)
    a, b = a.pose[sound], b.pose[sound]
    place = np.hypot(*(a[:, :2] - b[:, :2]).T)
    yaw = np.abs((a[:, 2] - b[:, 2] + np.pi) % (2 * np.pi) - np.pi)
    both = {"place": place, "yaw": yaw}
    return {k: {"median": float(np.median(v)), "p95": float(np.percentile(v, 95))} for k, v in both.items()}
