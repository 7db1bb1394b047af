"""The commands: one file each, `run` and no more. Nothing but the command line imports them."""
