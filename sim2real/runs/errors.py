"""Errors that a user can cause, and what ends a run: an interruption, a refusal."""

import errno

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
NO_FOLDER = (errno.EACCES, errno.EPERM, errno.EROFS, errno.EEXIST, errno.ENOTDIR, errno.EISDIR)


class Sim2RealError(ValueError):
    """Base of every error that a user of `sim2real` can cause; its text says what to do instead."""


class CheckpointError(Sim2RealError):
    """A checkpoint cannot be found, written or used here."""


class DamagedCheckpointError(CheckpointError):
    """A checkpoint's file is not as it was written."""


class DiskError(Sim2RealError):
    """A file of the run could not be written, such as on a full disk."""

    USUAL = (*NO_ROOM, *NO_FOLDER)  # errors of the file system that a user can remedy

    @staticmethod
    def remedy(error: OSError) -> str:
        """Return the remedy for an error of the file system."""
        if error.errno in NO_ROOM:
            return "free some space"
        return "name a folder that can be written, with out=FOLDER, or make this one writable"


class RunInterrupted(KeyboardInterrupt):
    """A run ended on request (Ctrl-C, SIGTERM), after it wrote a checkpoint.

    It is a KeyboardInterrupt so that a sweep stops with it. Its text is one sentence that says how
    to resume.

    Attributes:
        exit_code: what the process should exit with, 128 plus the signal's number.
    """

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class Refused(BaseException):
    """The sentence for a mistake; no Exception, so that Hydra lets it pass without a word."""
