"""Random numbers that are a pure function of (seed, stream, index), for many seeds at once.

    uniform(seeds, stream=0, size=6)      # (n, 6) in [0, 1), row i depends on seeds[i] alone

NumPy's generators hold one state each: one generator an episode costs 20 µs to make, for each of a
thousand rows. A counter-based hash has no state, so a row's numbers do not depend on the rows
before it or in parallel.
"""

from typing import Any

import numpy as np

from envs.physics.arrays import Array

_GOLDEN = np.uint64(
    0x9E3779B97F4A7C15
)  # SplitMix64 (Steele, Lea, Flood: Fast splittable pseudorandom numbers, 2014)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)


def _mix(x: np.ndarray) -> np.ndarray:
    x = (x ^ (x >> np.uint64(30))) * _MIX1
    x = (x ^ (x >> np.uint64(27))) * _MIX2
    return x ^ (x >> np.uint64(31))


def _mix_signed(x: Array) -> Array:
    """Return the same bits of signed integers, as torch has them: `>>` repeats their sign."""
    x = (x ^ ((x >> 30) & ((1 << 34) - 1))) * _signed(_MIX1)
    x = (x ^ ((x >> 27) & ((1 << 37) - 1))) * _signed(_MIX2)
    return x ^ ((x >> 31) & ((1 << 33) - 1))


def _signed(x: np.uint64) -> int:
    return int(x) - (1 << 64) if int(x) >> 63 else int(x)


def _uniform_signed(seeds: Array, stream: Array, size: int, xp: Any) -> Array:
    golden = _signed(_GOLDEN)
    start = _mix_signed(_mix_signed(seeds + golden) ^ _mix_signed(stream * golden + _signed(_MIX2)))
    counter = (xp.arange(size, dtype=xp.int64, device=seeds.device) + 1) * golden
    bits = _mix_signed(start[..., None] + counter)
    return xp.astype((bits >> 11) & ((1 << 53) - 1), xp.float64) * 2.0**-53


def uniform(seeds: Array, stream: int | Array, size: int, xp: Any = np) -> Array:
    """Return uniform numbers in [0, 1), (n, size) float64.

    Args:
        seeds: uint64, (n,); of another namespace int64 of the same bits.
        stream: which of the independent sequences of each seed (a purpose, a time step); an int
            or (n,).
        size: numbers per seed.
        xp: the namespace of the arrays.
    """
    if xp is not np:
        return _uniform_signed(seeds, stream, size, xp)
    seeds = np.asarray(seeds, dtype=np.uint64)
    with np.errstate(over="ignore"):
        start = _mix(
            _mix(seeds + _GOLDEN) ^ _mix(np.asarray(stream).astype(np.uint64) * _GOLDEN + _MIX2)
        )  # (n,)
        counter = (np.arange(size, dtype=np.uint64) + np.uint64(1)) * _GOLDEN  # (size,)
        bits = _mix(start[..., None] + counter)
    return (bits >> np.uint64(11)).astype(np.float64) * 2.0**-53


def normal(seeds: Array, stream: int | Array, size: int, xp: Any = np) -> Array:
    """Return standard normal numbers, (n, size) float64, by Box and Muller's transform."""
    pairs = (size + 1) // 2
    u = uniform(seeds, stream, 2 * pairs, xp)
    radius = xp.sqrt(-2.0 * xp.log1p(-u[..., :pairs]))
    angle = 2.0 * np.pi * u[..., pairs:]
    return xp.concat([radius * xp.cos(angle), radius * xp.sin(angle)], axis=-1)[..., :size]
