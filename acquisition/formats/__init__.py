"""File formats: readers of image folders, and writers of exports and reports."""
