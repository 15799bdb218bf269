"""The report of a result for a person: report.html and report.png."""

from acquisition.formats.report.advice import quality_warnings
from acquisition.formats.report.context import ReportContext
from acquisition.formats.report.page import PAGE, PICTURE, write

__all__ = ["PAGE", "PICTURE", "ReportContext", "quality_warnings", "write"]
