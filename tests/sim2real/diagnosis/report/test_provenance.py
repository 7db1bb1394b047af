"""What a report says of its making."""

from sim2real.diagnosis.report.provenance import flat


def test_words_are_written_apart_and_paths_are_kept() -> None:
    """A hash stands beside its log's own name, underscores and all."""
    tree = {"made_by": "me", "sha256": {"my_logs/run_1.csv": "abc"}, "exclude": []}
    assert flat(tree) == [
        ("made by", "me"),
        ("sha256: my_logs/run_1.csv", "abc"),
        ("exclude", "none"),
    ]
