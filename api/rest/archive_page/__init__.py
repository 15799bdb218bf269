"""The archive for reading: a page at `/archive` and the resources behind it, in the service or in a server of its own.

Nothing here writes to an archive. A cell's service has these routes where its settings name an archive; without a cell
they are all that `lightpose archive serve` serves. Needs the extra `archive`, so that a service imports it only then.
"""
