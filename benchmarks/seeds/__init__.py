"""The seeds' tables beside ours: figures of committed results, claims about them, one page."""
