"""Random generators: each component of an engine has its own.

So the draws of one component do not affect those of another. Code can move, and draws can be added
or removed, without a change in the trace of everything else.
"""

import random

_SEED_BITS = 128


class Generators:
    """Makes the random generators of one engine.

    Args:
        seed: What all of their numbers follow from.
    """

    def __init__(self, seed: str) -> None:
        self._seed = seed

    @classmethod
    def drawn_from(cls, rng: random.Random) -> "Generators":
        """Return a factory with a seed of one number of `rng`."""
        return cls(str(rng.getrandbits(_SEED_BITS)))

    def apart(self, owner: str) -> "Generators":
        """Return a factory whose generators belong to another owner of such components."""
        return Generators(f"{owner} {self._seed}")

    def of(self, component: str) -> random.Random:
        """Return a new generator.

        Args:
            component: Name of the component that draws from it. The same name gives the same
                numbers, so request each once.
        """
        # Seeding with a string uses SHA-512: unlike `hash`, that is the same in every process.
        return random.Random(f"{component} {self._seed}")
