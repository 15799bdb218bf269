"""Reports for people: report.html and report.png of a result, report.html of a calibration."""

from acquisition.formats.report.advice import quality_warnings
from acquisition.formats.report.calibration_page import write as write_calibration
from acquisition.formats.report.context import ReportContext
from acquisition.formats.report.page import PAGE, PICTURE, write

__all__ = ["PAGE", "PICTURE", "ReportContext", "quality_warnings", "write", "write_calibration"]
