"""What a diagnosis leaves: the page, its pictures and words, the corrected model."""
