"""The speed rows, side by side in one run: `make bench`.

    results = compare(default_rows(), repeats=3)
    write(results, Path("outputs/bench"))

Rows take turns, so that what happens to the machine happens to all of them; each figure is a median
over the rounds. The CPU time of other programs is measured during each run; a run that had too much
of it is taken again, a few times.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import median

from benchmarks.load import ForeignLoad, own_memory
from benchmarks.memory import measure
from benchmarks.rows.base import Row, Timing

BUSY = 0.15  # cores: above this a run is taken again
FAST = (  # PPO's parts that are faster, at the settings of Stable-Baselines3
    "collector=fast",
    "loss=fast_clip_ppo",
    "buffer=fast",
    "optimizer=fast_adam",
    "optimizer.lr=3e-4",
)
PATIENCE = 90.0  # s that taking runs again may cost in all


@dataclass
class Measured:
    """What was measured of a row."""

    row: Row
    timings: list[Timing] = field(default_factory=list)  # a run each
    loads: list[float] = field(default_factory=list)  # cores of other programs during it
    memory: float | None = None  # bytes a simulation

    @property
    def per_second(self) -> float:
        """Environment steps a second, the median of the runs."""
        return median(timing.per_second for timing in self.timings)

    @property
    def seconds(self) -> float:
        """Seconds of a run, the median."""
        return median(timing.seconds for timing in self.timings)

    @property
    def episode_length(self) -> float | None:
        """Mean length of its episodes in environment steps, or None where none ended."""
        episodes = sum(timing.episodes for timing in self.timings)
        return sum(timing.steps for timing in self.timings) / episodes if episodes else None


def compare(
    rows: Sequence[Row], repeats: int, say: Callable[[str], object], patience: float = PATIENCE
) -> tuple[list[Measured], list[str]]:
    """Build the rows, run them in turns, and close them.

    Runs beside other programs may be taken again for `patience` seconds in all.

    Returns:
        The rows that ran, and a line for each that could not.
    """
    skipped = [line for row in rows if (line := row.missing())]
    measured = [Measured(row) for row in rows if not row.missing()]
    for line in skipped:
        say(f"skipped {line}")
    built: list[Row] = []
    memory = measure() if any(one.row.memory for one in measured) else {}
    try:
        for one in measured:
            say(f"building {one.row.name}")
            one.row.build()
            built.append(one.row)
            one.memory = _memory(one.row, memory)
        for number in range(repeats):
            for one in measured:
                patience -= _run(one, patience)
                say(
                    f"round {number + 1}: {one.row.name} {one.timings[-1].per_second:.3g}/s, "
                    f"other load {one.loads[-1]:.2f} cores"
                )
                one.memory = one.row.peak() or one.memory
    finally:
        for row in built:
            row.close()
    return measured, skipped


def _memory(row: Row, kinds: dict[str, float]) -> float | None:
    """Return the bytes that each simulation of a row takes; of a worker, all that it holds."""
    if row.memory:
        return kinds.get(row.memory)
    total = own_memory(row.pids()) if row.pids() else None
    return None if total is None else total / row.simulations


def _run(one: Measured, patience: float) -> float:
    """Run a row until the machine is quiet or patience ends; keep the quietest run.

    Returns:
        The seconds that running it again took.
    """
    timing, load, seconds = _measure(one.row)
    spent = 0.0
    while load > BUSY and spent + seconds < min(patience, 3.5 * seconds):
        again, other, seconds = _measure(one.row)
        spent += seconds
        if other < load:
            timing, load = again, other
    one.timings.append(timing)
    one.loads.append(load)
    return spent


def _measure(row: Row) -> tuple[Timing, float, float]:
    begin, load = time.perf_counter(), ForeignLoad()
    timing = row.run()
    return timing, load.cores(), time.perf_counter() - begin


def default_rows(scale: float = 1.0) -> list[Row]:
    """Return the rows of `make bench`; at a scale of 1 most of their runs take 2 to 5 seconds."""
    from torchrl.envs import GymEnv

    from benchmarks.rows.batched import BatchedEnv, Collected, TrainingCollected, make_env
    from benchmarks.rows.contract import CheckContract
    from benchmarks.rows.diagnosis import Diagnose, Fit
    from benchmarks.rows.learning import Ours, StableBaselines3, TorchRLPPO
    from benchmarks.rows.members import Members, MembersTorchRL
    from benchmarks.rows.others import TASK, EnvPool, GymnasiumTorch, TorchRLParallel, Vectorized
    from benchmarks.rows.physics import RawPhysics
    from benchmarks.rows.pixels import BatchedPixels, Pixels
    from benchmarks.rows.population import ESPopulation, Evaluation, TwoProcesses
    from benchmarks.rows.walks import DiagnoseWalks, PriceCauses
    from benchmarks.world import THREADS, Gait, make_simulation

    def of(count: int) -> int:
        return max(1, round(count * scale))

    def batched(gait: Gait, end: str = "") -> list[Row]:
        """Return environments of two sizes, each behind the bare physics of what it does."""
        raw, large_raw = f"raw_physics{end}", f"raw_physics_n1024{end}"
        small = BatchedEnv(f"batched_env_n256{end}", 256, of(256), gait, raw)
        large = BatchedEnv(f"batched_env_n1024{end}", 1024, of(80), gait, large_raw)
        first = RawPhysics(raw, 256, small.record, THREADS, "raw_physics" if end else None)
        return [first, small, RawPhysics(large_raw, 1024, large.record, THREADS), large]

    def episodes(gait: Gait, each: int, rows: int, few: int, end: str = "") -> list[Row]:
        """Return whole episodes by a population and by processes, behind their bare physics."""
        job, raw = Evaluation(of(256), each, gait), f"raw_physics_es{end}"
        return [
            RawPhysics(raw, 256, lambda: job.tape(256), THREADS),
            ESPopulation(f"es_population{end}", job, rows, raw),
            TwoProcesses(f"es_two_processes_torch{end}", job, of(few), "torch", raw),
            TwoProcesses(f"es_two_processes_numpy{end}", job, of(few), "numpy", raw),
        ]

    def ppo(name: str, amount: int, setup: str, *words: str, long: bool = False) -> Row:
        """Return our PPO with the settings of Stable-Baselines3."""
        return Ours(name, "ppo_sb3", "ppo_sb3", of(amount), "env steps", setup, words, long)

    gait: Gait = "hopping"
    return [
        *batched(gait),
        *batched("fresh", "_fresh"),
        EnvPool("envpool", 256, of(256), gait, f"N = 256, {THREADS} threads, torch policy on 1"),
        Collected(
            "collector",
            256,
            lambda: make_env(make_simulation(256)),
            256 * of(64),
            4,
            gait,
            f"Collector over N = 256, {THREADS} physics threads, {of(64)} steps a batch",
        ),
        TrainingCollected(
            "collector_training",
            256 * of(64),
            4,
            gait,
            "the same with the transforms and the actor of the preset ppo",
        ),
        GymnasiumTorch(of(8000), gait),
        Vectorized("gymnasium_vector", 8, of(1500), gait, "SyncVectorEnv of 8, 1 thread"),
        Collected(
            "torchrl_gymenv_collector",
            1,
            lambda: GymEnv(TASK),
            of(1000),
            4,
            gait,
            "Collector over one GymEnv",
        ),
        TorchRLParallel(of(1500), gait),
        *episodes(gait, 1, 64, 48),
        # As many rows as episodes keep full: eight times the episodes, four times the rows.
        *episodes("fresh", 8, 256, 512, "_fresh"),
        StableBaselines3("ppo_sb3", "PPO", of(4096)),
        ppo(
            "ppo_same_schedule",
            24_000,
            "16 rows, 2048 steps, minibatches of 64, 10 epochs, all fast parts",
            *FAST,
        ),
        ppo(
            "ppo_fast_loss",
            12_000,
            "the same, TorchRL's collector, buffer and optimizer with our loss",
            "loss=fast_clip_ppo",
        ),
        ppo("ppo_clip_loss", 6_000, "the same, all parts TorchRL's"),
        ppo(
            "ppo_clip_loss_compiled",
            6_000,
            "the same, the loss compiled beforehand",
            "loss=clip_ppo_compiled",
            long=True,
        ),
        Ours("ppo_tuned", "ppo", "ppo_sb3", of(48_000), "env steps", "the preset ppo"),
        TorchRLPPO(of(2048)),
        StableBaselines3("trpo_sb3", "TRPO", of(4096)),
        Ours(
            "trpo",
            "trpo",
            "trpo_sb3",
            of(16_000),
            "env steps",
            "16 rows, 2048 steps, sb3-contrib's settings",
        ),
        MembersTorchRL(of(24)),
        Members(max(32, of(128))),
        StableBaselines3("sac_sb3", "SAC", of(300)),
        Ours("sac", "sac", "sac_sb3", of(400), "updates", "8 rows, 1 update a step"),
        Pixels("pixels_gymenv", 1, of(60), "GymEnv(from_pixels=True), 84 x 84"),
        BatchedPixels("gl", 32, of(40), f"N = 32, OpenGL in {THREADS} processes, 84 x 84"),
        BatchedPixels("rays", 128, of(60), f"N = 128, rays on {THREADS} threads, 84 x 84"),
        Fit("sysid", max(6.0, 24 * scale)),
        Fit("sim2real", max(6.0, 24 * scale)),
        Diagnose("diagnose_3_joints", 3, max(6.0, 48 * scale), 1),
        Diagnose("diagnose_6_joints", 6, max(6.0, 120 * scale), 3, long=True),
        CheckContract("contract", False, max(3.0, 60 * scale)),
        CheckContract("contract_fault", True, max(3.0, 60 * scale)),
        DiagnoseWalks("diagnose_quad8_walks", max(2, of(6))),
        PriceCauses("worth_quad8", max(4, of(64))),
    ]
