"""The paper's own examples: its tables, our tasks for them, what had to be assumed, and their reproduction."""

from pkmsea.paper.reproduce import Row, calibrated_numbers, paper_task, reproduce

__all__ = ["Row", "calibrated_numbers", "paper_task", "reproduce"]
