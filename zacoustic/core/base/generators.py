"""Random generators: each component of an engine has its own.

So the draws of one component do not affect those of another. Code can move, and draws can be added
or removed, without a change in the trace of everything else.
"""

import random
from copy import copy

_SEED_BITS = 128


class Generators:
    """Makes the random generators of one engine.

    Args:
        rng: Seeds them; one number is drawn from it.
    """

    def __init__(self, rng: random.Random) -> None:
        self._seed = str(rng.getrandbits(_SEED_BITS))

    def apart(self, owner: str) -> "Generators":
        """Return a factory whose generators belong to another owner of such components."""
        others = copy(self)
        others._seed = f"{owner} {self._seed}"
        return others

    def of(self, component: str) -> random.Random:
        """Return a new generator.

        Args:
            component: Name of the component that draws from it. The same name gives the same
                numbers, so request each once.
        """
        # Seeding with a string uses SHA-512: unlike `hash`, that is the same in every process.
        return random.Random(f"{component} {self._seed}")
