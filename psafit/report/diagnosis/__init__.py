"""The page of a diagnosis: a module for each of its sections, which `page` puts together."""

from psafit.report.diagnosis.page import write_diagnosis
from psafit.report.diagnosis.shown import shown_groups

__all__ = ["shown_groups", "write_diagnosis"]
