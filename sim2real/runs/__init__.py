"""Output of every run: checkpoints, metrics, tables, figures, films, its manifest."""
