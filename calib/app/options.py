"""Options that several capabilities take, each declared once."""

from typing import Annotated

from designer.base.options import option

MOST_JOBS = 1024
PhotoJobs = Annotated[int | None, option("photos at a time, all in memory (default: one per core)", 1, MOST_JOBS)]
