"""One random generator for each purpose of each direction between two nodes, from one seed.

If draws depended on the order of a driver's calls, every driver would simulate another sea. Here
each (seed, source, node, purpose) has a generator, and each frame of `source` draws from it the
same number of times, whatever happens elsewhere: the outcome of frame 17 from 1 to 2 is the same on
a virtual clock, on a wall clock, and after node 3 is added.

`random.Random` seeded with a string hashes it by SHA-512, and Python promises that the sequence of
its ``random()`` stays the same across versions. It makes no such promise for Gaussian draws, so
this module derives them from uniform ones.
"""

import math
import random

_TWO_PI = 2.0 * math.pi


def direction_random(seed: int, source: int, node: int, purpose: str) -> random.Random:
    """Return the generator of one purpose in the direction from `source` to `node`."""
    return random.Random(f"zacoustic/{seed}/{source}/{node}/{purpose}")


def gaussian_pair(rng: random.Random) -> tuple[float, float]:
    """Draw two independent standard normal numbers (Box and Muller); two uniform draws, always."""
    radius = math.sqrt(-2.0 * math.log(1.0 - rng.random()))
    angle = _TWO_PI * rng.random()
    return radius * math.cos(angle), radius * math.sin(angle)
