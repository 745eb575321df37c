"""A report as a notebook shows it."""

from __future__ import annotations

from dataclasses import dataclass

from wdpm.report.html import html_of
from wdpm.report.report import Report, from_dict
from wdpm.report.tables import report_lines, report_tables


@dataclass(frozen=True)
class NotebookReport(Report):
    """A report that a notebook shows as the tables and lines that a command prints."""

    def _repr_html_(self) -> str:
        return html_of([*report_tables(self), *report_lines(self)])


def notebook_report(data: object) -> NotebookReport:
    """The report of Image.metadata. Raises ImageError when it is another thing."""
    return NotebookReport(**vars(from_dict(data)))
