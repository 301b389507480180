"""Many recordings, one task each: on the cores of this machine, or on a Dask cluster; holds no science."""

from rampcast.batch.plan import STEPS, Plan, plan_of_files, read_plan
from rampcast.batch.running import batch
from rampcast.batch.tables import Done

__all__ = ["STEPS", "Done", "Plan", "batch", "plan_of_files", "read_plan"]
