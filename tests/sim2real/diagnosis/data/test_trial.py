"""Pieces of logs whose clock starts anywhere: the same ones, in the same memory."""

import tracemalloc

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.trial import choose
from sim2real.diagnosis.preflight.checks import preflight
from tests.sim2real.diagnosis import arm

UNIX = 1.7e9  # s since 1970
MOST = 2**25  # bytes


def test_pieces_do_not_depend_on_the_clocks_origin() -> None:
    """Of a log in memory that counts Unix seconds: moments from 0 on had taken 24 GB."""
    log = arm.make_log()
    late = Log({**log.columns, "time": log.time + UNIX}, log.meta)
    tracemalloc.start()
    pieces = choose([log], 2.0), choose([late], 2.0)
    assert tracemalloc.get_traced_memory()[1] < MOST
    tracemalloc.stop()
    for one, other in zip(*pieces, strict=True):
        assert np.allclose(one.column("time"), other.column("time") - UNIX, atol=1e-6)
        assert np.array_equal(one.column("qpos.a"), other.column("qpos.a"))


def test_preflight_does_not_depend_on_it() -> None:
    """The same findings, lags within a log included."""
    log = arm.make_log(seconds=24.0)
    late = Log({**log.columns, "time": log.time + UNIX}, log.meta)
    found = [[(f.check, f.where) for f in preflight([one], [arm.spec()])] for one in (log, late)]
    assert found[0] == found[1]
