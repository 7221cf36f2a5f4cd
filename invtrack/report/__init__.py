"""Reports: one page for a run, a study or an advice, that opens anywhere without a network."""

from invtrack.report.write import write_report

__all__ = ["write_report"]
