"""Policies of other libraries, and the interfaces that they were trained with; and one of ours.

`quad12` is the walking policy of `sim2real +experiment=quad12_es`, seed 0, as `sim2real export`
wrote it, without the archive of torch.

Those of other libraries were made at `studies-1` by `python -m benchmarks.policies`.
"""
