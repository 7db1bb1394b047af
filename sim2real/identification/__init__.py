"""From logs to a distribution of simulators.

A method fits a provider (what simulates) to data under a prior, and returns a distribution:

    method = Matching(score=KStep(rows=None), search=Cma())
    found = method.fit(Replay, prior, Recordings(read_logs("logs/"), "arm.xml"))
    write("distribution.yaml", found)

Providers are made of data and effects. `Replay` is aligned with the logs: it replays their commands
and says what the encoders would have said. `Rollout` lets a policy act: its transitions are like
the robot's or not, none belongs to another. A score compares what was measured with n simulations
and returns n numbers, the smaller the better; a search moves points to where it is small.
"""
