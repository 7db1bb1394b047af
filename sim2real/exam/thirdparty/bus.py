"""The bus between program and servos: when a command arrives, and how old a reading is.

bus = Bus(latency=0.001, age=0.0002, jitter=0.0001, counts=4096)
arrivals = bus.arrivals(stamps, rng)            # (T,) s
seen = bus.read(stamps, times, path, rng)       # (T, n) rad, in counts of the encoder
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Bus:
    """Times of one bus and the encoders that are read over it."""

    latency: float  # from writing a command till the servo has it [s]; what the nominal model knows
    age: float  # of a reading when its row's command is written [s]
    jitter: float  # half the spread of both [s]
    counts: float  # of the encoders in one turn, as the program reads them
    command_delay: float = 0.0  # further delay of commands [s]
    reading_delay: float = 0.0  # further age of readings [s]

    def arrivals(self, stamps: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return when the commands written at these times [s], (T,), take effect, in order."""
        late = self.latency + self.command_delay + self._noise(len(stamps), rng)
        return np.maximum.accumulate(stamps + late)

    def read(
        self, stamps: np.ndarray, times: np.ndarray, path: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """Return the program's readings in the rows of these stamps, (T, n) [rad].

        Args:
            stamps: when the rows' commands are written [s], (T,).
            times: of the robot's steps [s], (S,).
            path: its angles then, (S, n) [rad].
            rng: of the jitter.
        """
        late = self.age + self.reading_delay + self._noise(len(stamps), rng)
        count = 2 * np.pi / self.counts
        seen = [np.interp(stamps - late, times, column) for column in path.T]
        return np.round(np.transpose(seen) / count) * count

    def _noise(self, rows: int, rng: np.random.Generator) -> np.ndarray:
        return self.jitter * rng.uniform(-1, 1, rows)
