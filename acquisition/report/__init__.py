"""The page that a person reads: report.html and report.png of a result and of what is known of its images."""

from acquisition.report.advice import sentences
from acquisition.report.context import Facts
from acquisition.report.page import PAGE, PICTURE, write

__all__ = ["PAGE", "PICTURE", "Facts", "sentences", "write"]
