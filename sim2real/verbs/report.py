"""The verb `report`: what many training runs say together about transfer.

Intervals resample whole runs, since episodes of one policy say nothing about the next.
"""

import logging
from pathlib import Path

from sim2real.evaluation.hypotheses import ClaimResult, evaluate_claim, load_claims
from sim2real.evaluation.report import DRAWS, Report, claims_table, returns_csv
from sim2real.evaluation.study import Study, collect
from sim2real.evaluation.study_plots import Pictures
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

log = logging.getLogger(__name__)


def run(
    *, runs: str | list[str] | None, baseline: str | None, seed: int, out: Path
) -> list[ClaimResult]:
    """Write a report.

    Args:
        runs: a folder of runs, or a list; a text may name several with commas between.
        baseline: the experiment that every row is compared with; None for no comparison.
        seed: the seed of the bootstrap.
        out: the report's folder; gets report.md, report.csv (one row for each group and robot),
            returns.csv (one for each run and robot), claims.csv and plots/.

    Returns:
        What became of the claims.

    Raises:
        Sim2RealError: nothing to report, runs that do not belong together, a claim that says none.
    """
    if not runs:
        raise Sim2RealError("report needs runs; give runs=FOLDER or runs=[FOLDER,FOLDER]")
    given = runs.split(",") if isinstance(runs, str) else runs
    found = collect(path.strip() for path in given)
    study = Study(found)
    study.groups.sort(key=lambda group: group.experiment != baseline)  # that one first
    verdicts = [evaluate_claim(claim, study, seed, DRAWS) for claim in load_claims(found)]
    pictures = Pictures(study, baseline, Path(out), DRAWS, seed).draw()
    report = Report(study, baseline, seed)
    write_text(Path(out) / "report.csv", report.long_table().csv())
    write_text(Path(out) / "returns.csv", returns_csv(study))
    claims = claims_table(study, verdicts)
    write_text(Path(out) / "claims.csv", claims.csv())
    write_text(Path(out) / "report.md", report.markdown(found, claims, pictures))
    for verdict in verdicts:
        log.info("%s: %s (%s)", verdict.verdict, verdict.claim.text, verdict.found)
    log.info("report of %d evaluated runs: %s", len(found), Path(out) / "report.md")
    return verdicts
