"""The page that a person reads: report.html and report.png of a result and of what is known of its images."""

from acquisition.formats.report.advice import quality_warnings
from acquisition.formats.report.context import ReportContext
from acquisition.formats.report.page import PAGE, PICTURE, write

__all__ = ["PAGE", "PICTURE", "ReportContext", "quality_warnings", "write"]
