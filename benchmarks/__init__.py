"""Comparisons that take minutes or hours: how fast, and how good, against what else there is.

    python -m benchmarks                   # the speed rows, side by side: outputs/bench/
    python -m benchmarks --rows raw_physics,batched_env_n256
    python -m benchmarks --long            # the comparisons of returns, resumable

Nothing here is a test with a clock in it: a machine that is busy makes a figure doubtful, not a
build red.
"""
