"""The exam of the diagnosis: hide effects in an emulated robot, seal what was hidden, score."""
