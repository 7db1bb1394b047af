"""A report with something in every part of its page."""

import numpy as np

from sim2real.diagnosis import evidence as parts
from sim2real.diagnosis import schema


def trace(joint: str) -> parts.Trace:
    """Return 12 s of a joint, replayed in two windows, with each subset of two causes."""
    time = np.arange(0, 12, 0.02)
    measured, starts = np.sin(time), np.array([0, 300])
    shares = {(): 0.9, (0,): 0.95, (1,): 0.92, (0, 1): 0.99}
    lines = {frozenset(some): share * measured for some, share in shares.items()}
    ends = lines[frozenset()], lines[frozenset((0, 1))]
    return parts.Trace("a.csv", 0, joint, "rad", time, measured, *ends, 0.002, starts, lines)


def signal(kind: parts.Kind, unit: str) -> parts.Signal:
    """Return 12 s of what was logged of the elbow's servo."""
    time = np.arange(0, 12, 0.02)
    joint = "elbow" if kind == "command" else None
    return parts.Signal("a.csv", 0, kind, "elbow_servo", unit, joint, time, np.sin(time + 0.1))


def closed_loop() -> schema.ClosedLoop:
    """Return a policy whose corrected simulator is nearer to the robot."""
    distances = tuple(
        schema.Distance(
            measure,
            schema.Estimate(0.02, (0.015, 0.03)),
            schema.Estimate(0.54, (0.53, 0.55)),
            schema.Estimate(0.04, (0.034, 0.05)),
            schema.Estimate(0.5, (0.49, 0.51)),
        )
        for measure in ("sliced_wasserstein", "mmd")
    )
    returns = schema.Returns(
        schema.Estimate(0.137, (0.13, 0.14)),
        schema.Estimate(-0.006, (-0.007, -0.005)),
        schema.Estimate(0.139, (0.138, 0.14)),
    )
    channels = ("qpos.elbow", "gravity.imu.x")
    return schema.ClosedLoop(
        "runs/arm_es/checkpoint-30", channels, 6, 32, "nearer", distances, returns
    )


def report() -> schema.Report:
    """Return a report with something in every part of the page."""
    causes = (
        schema.Cause(
            *("backlash", "elbow", "link", 0.049, (0.045, 0.053), "rad", {}, 0.97, 0.8),
            equivalent=(schema.Equivalent("joint_compliance", "elbow"),),
        ),
        schema.Cause("command_delay", None, None, 0.018, (0.017, 0.02), "s", {}, 0.9, 0.15),
    )
    evidence = parts.Evidence(
        traces=(trace("elbow"), trace("shoulder")),
        ladder=(
            parts.Rung("model as given", 0.07, (0.06, 0.08)),
            parts.Rung("+ backlash", 0.02, (0.018, 0.022)),
            parts.Rung("+ command_delay", 0.005, (0.004, 0.006)),
            parts.Rung("noise floor", 0.002, (0.002, 0.002)),
        ),
        singles=tuple(
            parts.SingleFit(
                "armature", f"joint{k}", None, 0.01, "kg·m²", 0.5 - 0.06 * k, (-0.1, 0.6)
            )
            for k in range(10)
        ),
        bands=(parts.Band("elbow", 0.0, 1.0, 0.06, 0.004, 0.001),),
        inputs={
            "logs": ["a.csv"],
            "models": ["arm.xml"],
            "seed": 3,
            "versions": {"mujoco": "4"},
            "made": "2026-11-22 10:00+00:00",
            "robots": ["arm2"],
            "sha256": {"logs/a.csv": "0123456789abcdef" * 4},
        },
        correlations=np.array([[1.0, -0.62], [-0.62, 1.0]]),
        channels=(parts.ChannelGap("qvel.elbow", "rad/s", 0.01, 0.2, 0.02),),
        signals=(signal("command", "rad"), signal("current", "A"), signal("voltage", "V")),
    )
    return schema.Report(
        verdict="explained",
        gap=schema.GapMetrics("rad", 0.07, 0.005, 0.002, 0.956, (0.93, 0.97), True),
        where=(
            schema.JointGap(
                "elbow",
                0.8,
                0.09,
                0.006,
                (schema.Regime("reversal", 0.5), schema.Regime("hold", 0.25)),
            ),
            schema.JointGap("shoulder", 0.2, 0.02, 0.003, (schema.Regime("reversal", 0.1),)),
        ),
        causes=causes,
        unexplained=schema.Unexplained(0.04, "slow, at the shoulder"),
        preflight=(
            schema.Finding("sign", "wrist", "it moves the other way", "negate qpos.wrist"),
            schema.Finding("quantization", "elbow", "It comes in steps.", "Nothing to mend."),
        ),
        numerics={"timestep": "ok", "solver": "halves the gap"},
        next_experiment="ramps without load",
        seconds=31.0,
        closed_loop=closed_loop(),
        evidence=evidence,
    )
