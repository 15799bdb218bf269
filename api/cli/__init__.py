"""The command line `lightpose`."""
