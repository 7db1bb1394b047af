"""What every run leaves behind: checkpoints, metrics, tables, figures, films, its manifest."""
