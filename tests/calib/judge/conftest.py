"""These tests draw no figures of calibrations."""

from tests.support.run_folders import nothing_is_drawn

__all__ = ["nothing_is_drawn"]
