"""The page that a person reads: report.html and report.png of a result and of what is known of its images."""

from acquisition.normals.report.advice import sentences
from acquisition.normals.report.facts import Facts
from acquisition.normals.report.page import PAGE, PICTURE, write

__all__ = ["PAGE", "PICTURE", "Facts", "sentences", "write"]
