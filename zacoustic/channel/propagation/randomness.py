"""One random generator for each purpose of each direction between two nodes, from one seed.

A channel whose draws depend on the order in which a driver happens to call it gives another sea for
every driver. Here each (seed, source, node, purpose) owns a generator, and each frame of `source`
draws from it the same number of times, whatever happens elsewhere: the fate of frame 17 from 1 to 2
is the same on a virtual clock, on a wall clock, and when node 3 is added.

`random.Random` seeded with a string hashes it by SHA-512, and the sequence of its ``random()`` is
promised to stay the same across versions of Python; Gaussian draws are made from it here, since
those of the standard library carry no such promise.
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
