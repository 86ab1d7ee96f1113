"""The paper's own examples: its tables, our tasks for them, what had to be assumed, and their reproduction."""

from pkmsea.paper.readings import READINGS, Reading, calibrated_numbers, paper_task, table_task
from pkmsea.paper.reproduce import Row, reproduce

__all__ = ["READINGS", "Reading", "Row", "calibrated_numbers", "paper_task", "reproduce", "table_task"]
