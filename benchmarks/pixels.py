"""Does a policy that sees need more than one image? The pixels of the transfer study.

    python -m benchmarks.pixels                                 # hours
    python -m benchmarks.pixels --rows single stack4 --seeds 0 1 2
    python -m benchmarks.pixels --report                        # the tables of what there is

Trains on one colour image and on four grey ones, 100,000 steps and 3 seeds each as the study did,
drawn by rays and by OpenGL; then four images for half a million steps with either, with a lower
learning rate, and under drawn colours, light and cameras. After each round of seeds `run=report`
writes its tables and pictures to benchmarks/results/pixels/.

Each run has a folder of its own: what is complete is skipped, what was interrupted is continued.
Several of these programs may run at once and share the work.
"""

import sys

from benchmarks.study import Row, Study

SHORT, LONG = 100_000, 500_000  # environment steps
GL = ("env.renderer=gl",)
MAIN = (Row("single", "pixels_single", 3, (SHORT,)), Row("stack4", "pixels_stack4", 3, (SHORT,)))
LONGER = (
    Row("stack4_long", "pixels_stack4", 1, (LONG,), folder="stack4"),
    Row("stack4_gl_long", "pixels_stack4", 1, (SHORT, LONG), GL, folder="stack4_gl"),
)
OPENGL = (
    Row("single_gl", "pixels_single", 3, (SHORT,), GL),
    Row("stack4_gl", "pixels_stack4", 3, (SHORT,), GL),
)
BEYOND = (
    Row("stack4_lr1e4", "pixels_stack4_lr1e4", 3, (SHORT,)),
    Row("stack4_appearance", "pixels_stack4", 3, (SHORT,), ("params=appearance",)),
)
STUDY = Study("pixels", __doc__ or "", (MAIN, LONGER, OPENGL, BEYOND))

if __name__ == "__main__":
    sys.exit(STUDY.main())
