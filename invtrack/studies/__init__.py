"""Studies: named cases on a plant, run, recorded, drawn and summarised by one mechanism."""

from invtrack.studies.options import StudyOptions
from invtrack.studies.session import DivergedError, MissingError, Session
from invtrack.studies.study import Case, Setup, Study, Table
from invtrack.studies.table import Cell, Column, Rows, print_table

__all__ = [
    "Case",
    "Cell",
    "Column",
    "DivergedError",
    "MissingError",
    "Rows",
    "Session",
    "Setup",
    "Study",
    "StudyOptions",
    "Table",
    "print_table",
]
